"""The algorithms of navigation, without ROS: poses, grids, transforms, particle filter, planners."""
