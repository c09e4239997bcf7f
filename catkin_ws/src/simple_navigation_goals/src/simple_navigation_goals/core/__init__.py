"""Logic without ROS: waypoints, their queue, patrols, and the spin recovery."""
