"""What has been wrong with the robots: since when, and until when."""

import re
from typing import NamedTuple

_NUMBER = re.compile(r"(?<![\w.])-?\d+(\.\d+)?")
MOST = 200
"""Maximum number of alerts kept; the oldest are dropped."""


class Alert(NamedTuple):
    """A fault of a robot."""

    robot: str
    what: str
    since: float  #: seconds since 1970
    until: float | None = None  #: likewise; None while it lasts

    def values(self) -> dict[str, str | float | None]:
        """Returns what a page shows."""
        return self._asdict()


class Alerts:
    """The faults of all robots, from the oldest to the newest."""

    def __init__(self) -> None:
        #: by number
        self._alerts: dict[int, Alert] = {}
        #: number of each robot's alert that lasts
        self._lasting: dict[str, int] = {}
        self._count = 0
        self._values: list[dict[str, str | float | None]] = []

    def update(self, robot: str, fault: str, now: float) -> None:
        """Records that a robot has this fault now (seconds since 1970), none if it is empty.

        Ages and places in the words of a fault do not make it another one; its words are renewed.
        """
        lasting = self._lasting.get(robot)
        if lasting is None and not fault:
            return
        if lasting is not None:
            alert = self._alerts[lasting]
            if fault == alert.what:
                return
            if fault and _without_numbers(alert.what) == _without_numbers(fault):
                self._alerts[lasting] = alert._replace(what=fault)
                self._values = [each.values() for each in self._alerts.values()]
                return
            self._alerts[lasting] = alert._replace(until=now)
            del self._lasting[robot]
        if fault:
            self._lasting[robot] = self._count
            self._alerts[self._count] = Alert(robot, fault, now)
            self._count += 1
            self._drop_oldest()
        self._values = [alert.values() for alert in self._alerts.values()]

    def values(self) -> list[dict[str, str | float | None]]:
        """Returns what a page shows; the same object while nothing has changed."""
        return self._values

    def _drop_oldest(self) -> None:
        """Drops the oldest alert that is over if there are too many."""
        if len(self._alerts) <= MOST:
            return
        lasting = set(self._lasting.values())
        oldest = next((number for number in self._alerts if number not in lasting), None)
        if oldest is not None:
            del self._alerts[oldest]


def _without_numbers(text: str) -> str:
    """Returns a text without ages and coordinates; numbers in names such as pioneer2 stay."""
    return _NUMBER.sub("", text)
