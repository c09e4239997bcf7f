"""Per-link options of a rule: rate limit, queue size, filter, compression."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rocon_relay.error import RelayError
from rocon_relay.pattern import PatternError, check_pattern, matches_whole

LEAST_RATE = 1e-3
"""Minimum rate [Hz]. It keeps the waiting times within the range of a timer."""


class OptionError(RelayError):
    """An invalid option."""


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """Processing at the source before messages are sent on a link; none by default."""

    rate: float = 0.0  #: maximum message rate; the newest message is sent; 0 is unlimited [Hz]
    #: maximum number of messages queued for a slow link, the oldest are dropped; 0 applies back-pressure to the
    #: publisher instead
    queue_size: int = 0
    compress: bool = False  #: compresses messages with zlib
    #: regular expressions: only transforms whose child frame matches all of them are sent in a tf message
    tf_frames: tuple[str, ...] = ()
    #: maximum rate by message stamps, independent of the real-time factor: the first message of each period is sent;
    #: messages without a stamp always are; 0 is unlimited [Hz]. For clocks, tf (per set of frames), and types that
    #: begin with a header.
    stamp_rate: float = 0.0

    def __post_init__(self) -> None:
        """Raises OptionError for a rate below `LEAST_RATE`."""
        for name, rate in (("rate", self.rate), ("stamp_rate", self.stamp_rate)):
            if 0 < rate < LEAST_RATE:
                raise OptionError(f"{name} is {rate:g}; the least is {LEAST_RATE:g} Hz")

    @property
    def needs_messages(self) -> bool:
        """Whether the source has to look at whole messages."""
        return bool(self.rate or self.compress or self.tf_frames or self.stamp_rate)

    @property
    def limit(self) -> str:
        """The rate limit as readable text; "" if there is none."""
        return f"at most {self.rate:g} messages a second" if self.rate else ""

    def joined(self, other: "LinkOptions") -> "LinkOptions":
        """Returns options that satisfy both."""
        return LinkOptions(
            _least(self.rate, other.rate),
            int(_least(self.queue_size, other.queue_size)),
            self.compress or other.compress,
            tuple(dict.fromkeys((*self.tf_frames, *other.tf_frames))),
            _least(self.stamp_rate, other.stamp_rate),
        )

    def fields(self) -> dict[str, str]:
        """Returns the fields for a link's hello and welcome, one for each enabled option."""
        fields = {
            "rate": str(float(self.rate)) if self.rate else "",
            "queue_size": str(self.queue_size or ""),
            "compress": "zlib" if self.compress else "",
            "tf_frames": "".join(self.tf_frames[:1]),
            "stamp_rate": str(float(self.stamp_rate)) if self.stamp_rate else "",
        }
        return {key: value for key, value in fields.items() if value}

    def keeps_frame(self) -> Callable[[str], bool]:
        """Returns a predicate for child frames: whether such a transform is sent. It ignores a leading slash."""
        return lambda frame: all(matches_whole(one, frame.lstrip("/")) for one in self.tf_frames)


NO_OPTIONS = LinkOptions()
"""Messages are sent unchanged."""


def _least(*limits: float) -> float:
    return min((limit for limit in limits if limit), default=0)


def check_frames(pattern: str) -> None:
    """Raises OptionError if the pattern is not a regular expression."""
    try:
        check_pattern(pattern)
    except PatternError as error:
        raise OptionError(
            f"the tf_frames pattern '{pattern}' is not a regular expression: {error}"
        ) from None


def options_from_fields(fields: Mapping[str, str]) -> LinkOptions:
    """Returns the options in a hello.

    Raises:
        OptionError: an option is invalid.
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
        raise OptionError(
            f"rate {rate}, stamp_rate {stamp_rate} or queue_size {queue_size} is out of bounds"
        )
    pattern = fields.get("tf_frames", "")
    check_frames(pattern)
    return LinkOptions(rate, queue_size, bool(compress), (pattern,) if pattern else (), stamp_rate)
