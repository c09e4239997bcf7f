"""Code that needs neither ROS nor processes: waypoints, tracks, evaluation, texts for users."""
