"""What a run is: options, scenario files, worlds, waypoints, faulty links. Checked before anything starts."""
