"""What is known, and what it means: no ROS."""
