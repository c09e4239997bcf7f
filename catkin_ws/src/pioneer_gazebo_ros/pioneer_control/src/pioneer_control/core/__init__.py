"""The ROS-free part: which topics and services of a master stop and cancel robots."""
