"""A fleet's processes: their commands, start, end, deaths, costs and emulated links."""
