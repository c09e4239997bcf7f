"""The errors of rocon_launch."""


class ConcertError(Exception):
    """An invalid .concert file or command line; the text says where and why."""
