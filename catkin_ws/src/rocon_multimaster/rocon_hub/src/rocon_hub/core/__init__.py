"""What the hub decides: no ROS, no process, no clock."""
