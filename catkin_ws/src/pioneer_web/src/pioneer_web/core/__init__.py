"""Code that does not need ROS: access control, commands, and the data sent to pages."""
