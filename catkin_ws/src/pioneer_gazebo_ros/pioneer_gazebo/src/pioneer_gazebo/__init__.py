"""The simulator: pybullet behind Gazebo's ROS interface."""
