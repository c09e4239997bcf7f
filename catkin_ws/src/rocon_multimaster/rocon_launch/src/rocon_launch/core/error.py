"""What rocon_launch raises."""


class ConcertError(Exception):
    """An invalid .concert file or command line; the text says where and why."""
