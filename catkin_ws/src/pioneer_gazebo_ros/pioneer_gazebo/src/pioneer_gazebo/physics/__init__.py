"""The physics engine: its interface, pybullet behind it, and the bounds of what it is given."""
