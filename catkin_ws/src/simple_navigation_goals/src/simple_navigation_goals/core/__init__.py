"""What needs no ROS: waypoints, their queue, and when a robot that stands still should turn."""
