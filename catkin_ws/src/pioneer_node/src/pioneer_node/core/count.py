"""Formats counts with singular and plural nouns."""


def counted(count: int, noun: str) -> str:
    """Returns a number and its noun: 1 robot, 2 robots."""
    return f"{count} {noun}" + ("s" if count != 1 else "")
