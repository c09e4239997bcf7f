"""The command-line tools, and the Python interface of rocon's tests."""
