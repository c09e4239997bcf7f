"""Wheel and joint-state controller configuration, ESTOP and cancel_waypoint."""
