"""What rocon_launch raises."""


class ConcertError(Exception):
    """A .concert file, or a command line, that cannot be meant; the text says where and why."""
