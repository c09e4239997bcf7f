"""The pure core of the hub: no ROS, processes or clocks."""
