"""The main job: a fleet on several masters in one command, its live view and its report."""
