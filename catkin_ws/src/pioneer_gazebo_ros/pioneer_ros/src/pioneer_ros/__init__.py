"""The velocity controller between move_base and the robot."""
