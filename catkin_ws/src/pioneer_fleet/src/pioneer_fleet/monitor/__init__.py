"""The state of robots and computers: shared by ``report``, the demo and the page."""
