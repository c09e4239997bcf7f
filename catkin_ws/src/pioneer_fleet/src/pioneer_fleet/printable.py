"""Text of other programs for a terminal, which must not control it."""


def printable(text: str, kept: str = "\n") -> str:
    """Returns ``text`` with escapes in place of characters that control a terminal, but for those in ``kept``."""
    return "".join(
        char if char.isprintable() or char in kept else repr(char)[1:-1] for char in text
    )
