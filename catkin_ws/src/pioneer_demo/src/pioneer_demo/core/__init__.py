"""What needs no ROS and no process: waypoints, tracks, the verdict, the texts people read."""
