"""What needs no ROS: which topics and services of a master stop and cancel robots."""
