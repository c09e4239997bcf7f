"""Code that does not need ROS: frame names, parameters, documents."""
