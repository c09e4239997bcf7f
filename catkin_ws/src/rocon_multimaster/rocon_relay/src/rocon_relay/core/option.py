"""What a rule may ask of its links beyond carrying: how often, how much may wait, what of it, and how small."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rocon_relay.core.error import RelayError
from rocon_relay.core.pattern import PatternError, compiled, matches_whole

LEAST_RATE = 1e-3
"""The smallest rate [Hz]: what waits its turn waits for a time that a clock can hold."""


class OptionError(RelayError):
    """An invalid option."""


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """What the source does before anything crosses a link; nothing by default."""

    rate: float = 0.0  #: at most so many messages a second cross, always the newest; 0 is any number [Hz]
    #: so many messages wait for a slow link at most, the oldest are dropped; 0 leaves that to the publisher, which is
    #: slowed instead
    queue_size: int = 0
    compress: bool = False  #: messages cross deflated (zlib, level 1)
    #: regular expressions: of a tf message only transforms cross whose child frame matches each of them
    tf_frames: tuple[str, ...] = ()
    #: at most so many messages a second of their own stamps cross, whatever the real-time factor, each the first of its
    #: period, and those without a stamp; 0 is any number [Hz]. For clocks, tf (each set of frames for itself), and
    #: types that begin with a header.
    stamp_rate: float = 0.0

    def __post_init__(self) -> None:
        """Raises OptionError for a rate that is less than `LEAST_RATE`."""
        for name, rate in (("rate", self.rate), ("stamp_rate", self.stamp_rate)):
            if 0 < rate < LEAST_RATE:
                raise OptionError(f"{name} is {rate:g}; the least is {LEAST_RATE:g} Hz")

    @property
    def needs_messages(self) -> bool:
        """Whether the source has to look at whole messages."""
        return bool(self.rate or self.compress or self.tf_frames or self.stamp_rate)

    @property
    def limit(self) -> str:
        """The rate for people; "" without one."""
        return f"at most {self.rate:g} messages a second" if self.rate else ""

    def joined(self, other: "LinkOptions") -> "LinkOptions":
        """Returns what satisfies both."""
        return LinkOptions(
            _least(self.rate, other.rate),
            int(_least(self.queue_size, other.queue_size)),
            self.compress or other.compress,
            tuple(dict.fromkeys((*self.tf_frames, *other.tf_frames))),
            _least(self.stamp_rate, other.stamp_rate),
        )

    def fields(self) -> dict[str, str]:
        """The fields of a link's hello and welcome; none for an option that is not asked for."""
        fields = {
            "rate": str(float(self.rate)) if self.rate else "",
            "queue_size": str(self.queue_size or ""),
            "compress": "zlib" if self.compress else "",
            "tf_frames": "".join(self.tf_frames[:1]),
            "stamp_rate": str(float(self.stamp_rate)) if self.stamp_rate else "",
        }
        return {key: value for key, value in fields.items() if value}

    def keeps_frame(self) -> Callable[[str], bool]:
        """Returns what tells whether a transform with this child frame crosses; a leading slash counts for nothing."""
        return lambda frame: all(matches_whole(one, frame.lstrip("/")) for one in self.tf_frames)


NO_OPTIONS = LinkOptions()
"""Everything crosses as it is."""


def _least(*limits: float) -> float:
    return min((limit for limit in limits if limit), default=0)


def check_frames(pattern: str) -> None:
    """Raises OptionError for a pattern that is no regular expression."""
    try:
        compiled(pattern)
    except PatternError as error:
        raise OptionError(f"the tf_frames pattern '{pattern}' is not a regular expression: {error}") from None


def options_from_fields(fields: Mapping[str, str]) -> LinkOptions:
    """Returns the options in a hello.

    Raises:
        OptionError: they are not sound.
    """
    compress = fields.get("compress", "")
    if compress not in ("", "zlib"):
        raise OptionError(f"it asks for compression '{compress}'")
    try:
        rate, stamp_rate = (float(fields.get(name) or 0) for name in ("rate", "stamp_rate"))
        queue_size = int(fields.get("queue_size") or 0)
    except ValueError as error:
        raise OptionError(f"rate, stamp_rate or queue_size: {error}") from None
    if not (0 <= rate < math.inf and 0 <= stamp_rate < math.inf and queue_size >= 0):
        raise OptionError(f"rate {rate}, stamp_rate {stamp_rate} or queue_size {queue_size} is out of bounds")
    pattern = fields.get("tf_frames", "")
    check_frames(pattern)
    return LinkOptions(rate, queue_size, bool(compress), (pattern,) if pattern else (), stamp_rate)
