"""Services of gazebo_ros: models, links, joints, time and physics."""
