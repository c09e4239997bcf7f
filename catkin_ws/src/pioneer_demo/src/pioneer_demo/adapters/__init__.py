"""One foreign thing each: map files, folders of worlds, the terminal, the picture, a fleet's processes, the gateway."""
