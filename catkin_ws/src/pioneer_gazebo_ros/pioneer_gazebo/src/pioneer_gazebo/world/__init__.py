"""Descriptions: worlds, robots, shapes and poses, and the readers of SDF, URDF, meshes and parameters."""
