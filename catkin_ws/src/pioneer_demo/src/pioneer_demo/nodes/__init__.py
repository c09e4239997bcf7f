"""The demo's ROS side: the observer node, fleet control, and the commands."""
