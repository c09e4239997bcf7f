"""What needs no ROS: who may do what, commands, and what a page gets."""
