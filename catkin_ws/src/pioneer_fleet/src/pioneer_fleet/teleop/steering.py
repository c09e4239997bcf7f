"""Maps keys to speeds."""

import dataclasses

_LINEAR_STEP, _ANGULAR_STEP = 0.1, 0.2
_LINEAR_MOST, _ANGULAR_MOST = 1.0, 1.0
KEYS = {"w": (1, 0), "s": (-1, 0), "a": (0, 1), "d": (0, -1)}
"""Keys that change the speed: number of steps forwards and to the left."""


@dataclasses.dataclass(frozen=True)
class Steering:
    """The commanded speed [m/s, rad/s]."""

    linear: float = 0.0
    angular: float = 0.0

    def after(self, key: str) -> "Steering":
        """Returns the speed after a key press: one step more or less for ``KEYS``, zero for any other key."""
        if key not in KEYS:
            return Steering()
        forwards, left = KEYS[key]
        linear = self.linear + forwards * _LINEAR_STEP
        angular = self.angular + left * _ANGULAR_STEP
        return Steering(_bounded(linear, _LINEAR_MOST), _bounded(angular, _ANGULAR_MOST))


def _bounded(value: float, most: float) -> float:
    return round(max(-most, min(most, value)), 3)
