"""The simulator's values and algorithms, independent of ROS and of the physics engine."""
