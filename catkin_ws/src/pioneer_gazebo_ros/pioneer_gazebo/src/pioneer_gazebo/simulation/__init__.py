"""The running simulation: entities, drives, actors, wrenches, spawning, schedule. No ROS, no engine."""
