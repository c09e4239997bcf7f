"""slam_gmapping: a grid map from scans and odometry, with a particle filter."""
