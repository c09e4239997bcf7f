"""The command itself: progress on a terminal, Ctrl-C, wall time, the output folder."""
