"""Tables and lists for terminals."""

from collections.abc import Sequence


def table(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Returns headers and rows as aligned columns; the last column is not padded."""
    lines = [headers, *rows]
    widths = [max(len(line[column]) for line in lines) for column in range(len(headers) - 1)]
    return "\n".join(_padded(line, widths) for line in lines)


def _padded(line: Sequence[str], widths: Sequence[int]) -> str:
    cells = [cell.ljust(width) for cell, width in zip(line, widths, strict=False)]
    return "  ".join([*cells, line[-1]]).rstrip()


def listing(title: str, entries: Sequence[str]) -> str:
    """Returns a title with the number of entries, and each entry on its own line below."""
    return "\n".join([f"{title} ({len(entries)})", *(f"  {entry}" for entry in entries)])
