"""Navigation nodes (map_server, amcl, move_base, slam_gmapping) and their launch files."""
