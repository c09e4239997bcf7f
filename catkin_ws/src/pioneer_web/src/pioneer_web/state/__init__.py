"""What is known of robots and base station, and how it gets to pages and ``/metrics``."""
