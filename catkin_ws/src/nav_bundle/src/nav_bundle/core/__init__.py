"""Navigation algorithms without ROS: poses, grids, transforms, particle filter, planners."""
