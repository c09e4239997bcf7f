"""Colours of Gazebo's named materials."""

from pioneer_gazebo.core.world import Colour

GREY: Colour = (0.7, 0.7, 0.7, 1.0)
_COLOURS: dict[str, Colour] = {
    "grey": GREY,
    "gray": GREY,
    "darkgrey": (0.175, 0.175, 0.175, 1.0),
    "lightgrey": (0.85, 0.85, 0.85, 1.0),
    "white": (1.0, 1.0, 1.0, 1.0),
    "flatblack": (0.1, 0.1, 0.1, 1.0),
    "black": (0.0, 0.0, 0.0, 1.0),
    "red": (1.0, 0.0, 0.0, 1.0),
    "redbright": (0.87, 0.26, 0.07, 1.0),
    "green": (0.0, 1.0, 0.0, 1.0),
    "blue": (0.0, 0.0, 1.0, 1.0),
    "skyblue": (0.13, 0.44, 0.70, 1.0),
    "yellow": (1.0, 1.0, 0.0, 1.0),
    "zincyellow": (0.97, 0.92, 0.15, 1.0),
    "gold": (0.8, 0.65, 0.0, 1.0),
    "purple": (1.0, 0.0, 1.0, 1.0),
    "turquoise": (0.0, 1.0, 1.0, 1.0),
    "orange": (1.0, 0.51, 0.06, 1.0),
    "indigo": (0.33, 0.0, 0.5, 1.0),
    "wood": (0.65, 0.45, 0.25, 1.0),
    "bricks": (0.6, 0.3, 0.2, 1.0),
}


def colour_of_material(name: str) -> Colour | None:
    """Returns the colour of ``Gazebo/NAME``, ignoring case; None for an unknown name."""
    return _COLOURS.get(name.rpartition("/")[2].lower())
