"""One foreign thing each: map files, the terminal, the picture, the processes of a fleet, the gateway."""
