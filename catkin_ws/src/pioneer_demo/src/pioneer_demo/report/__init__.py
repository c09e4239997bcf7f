"""What people see of a run: live texts, report, picture, video."""
