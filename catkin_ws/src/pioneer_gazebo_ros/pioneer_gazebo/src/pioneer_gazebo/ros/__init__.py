"""What every part of the node uses to talk ROS: services, frames of messages, topics that never block."""
