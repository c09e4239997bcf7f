"""Programs of rclpy, for the bench of the door. They run in an environment of their own, without this package."""
