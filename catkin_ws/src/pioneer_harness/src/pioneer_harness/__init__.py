"""Masters on free ports, wait-for-condition and process groups that always end, for tests and the demo."""
