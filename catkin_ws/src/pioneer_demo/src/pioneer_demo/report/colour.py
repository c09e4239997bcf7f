"""Robot colours, the same in pictures and videos."""

ROBOTS = (
    "#1f6feb", "#e4572e", "#2a9d5c", "#9b4dca", "#d99a00", "#0fa3b1", "#c2255c", "#6b705c",
    "#5c7cfa", "#a0522d", "#74a12e", "#f06595", "#495057", "#20a39e", "#b5651d",
)  # fmt: skip

UNKNOWN, FREE, WALL = "#e7e9ec", "#ffffff", "#2f3640"


def of_robot(index: int) -> str:
    """Returns the colour of a robot; ``index`` counts from 0."""
    return ROBOTS[index % len(ROBOTS)]
