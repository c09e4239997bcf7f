"""Status reports, recording, replay and teleoperation of the fleet."""
