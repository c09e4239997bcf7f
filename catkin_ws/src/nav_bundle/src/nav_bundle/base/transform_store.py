"""Stores the transforms that a node uses, read from the bytes of /tf and /tf_static.

tf2_ros' Python listener unpacks and stores every transform of every robot; with 50 robots this takes most of a core.
This store searches the bytes of /tf for the few edges in use and unpacks only those. It keeps all static transforms,
which are few and latched.
"""

import math
import threading
from collections.abc import Callable

from nav_bundle.base.tf_message import Refuse, StampedTransform, TransformPicker, transforms_of
from nav_bundle.base.transform import (
    DisconnectedError,
    FrameNameError,
    Transform,
    TransformTree,
    frame_fault,
)
from pioneer_node.core.frame import stripped

HISTORY, FUTURE_LIMIT = 10.0, 10.0
"""History of each edge [s], and by default how far ahead of the clock a transform may be stamped [s]."""
MOST_AHEAD = 5.0
"""Transforms are stamped less than this far ahead of the clock [s]; amcl's are ahead by its transform_tolerance."""

_MOST_PAIRS = 512


class ClockJump:
    """Detects jumps back in time, and which stamps precede the jump. Times are ROS times [s].

    /clock and stamped messages arrive on separate connections, so the last transforms from before the jump may arrive
    after it. If accepted, they would count as the newest until the clock reaches that time again.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self._before = -math.inf

    def jumped(self, now: float) -> bool:
        """Stores the time ``now``; returns whether it is earlier than the last one."""
        back = now < self.now
        if back:
            self._before = max(self._before, self.now)
        self.now = now
        return back

    def is_of_before(self, stamp: float) -> bool:
        """Returns whether ``stamp`` precedes the last jump: it is far ahead, and the clock has not caught up yet."""
        return self.now < self._before and stamp > self.now + MOST_AHEAD


class TransformStore:
    """Transforms between the requested pairs of frames.

    Transforms for a pair of frames are recorded from its first ``lookup`` or ``listen``; call ``listen`` early. The
    number of pairs is limited; beyond the limit, the least recently requested pair is dropped.
    When time jumps back, the store clears all but the static transforms and ignores late transforms from before the
    jump. Thread-safe.

    On error: a message that does not parse, an invalid transform, and a transform stamped more than ``future_limit``
        ahead of the clock are dropped with a warning.

    Args:
        now: returns ROS time [s].
        warn: called with a warning line, possibly often.
        future_limit: how far ahead of the clock a transform may be stamped [s]; one from the far future would count
            as the newest until then.
    """

    def __init__(
        self,
        now: Callable[[], float],
        warn: Refuse,
        future_limit: float = FUTURE_LIMIT,
    ) -> None:
        self.arrived = threading.Condition()  #: notified after each message with usable transforms
        self._now, self._warn = now, warn
        self._tree = TransformTree(HISTORY)
        self._picker = TransformPicker(warn)
        self._future_limit = future_limit
        self._pairs: dict[tuple[str, str], None] = {}
        self._fixed: set[str] = set()
        self._clock = ClockJump()

    def listen(self, target: str, source: str) -> None:
        """Starts recording the transforms that connect the two frames."""
        with self.arrived:
            self._listen(target, source)

    def lookup(self, target: str, source: str, stamp: float | None = None) -> Transform:
        """Returns target_from_source at ROS time ``stamp`` [s], or at the newest common time when None.

        Raises:
            DisconnectedError: the frames are not connected, or not yet.
            ExtrapolationError: connected, but not at ``stamp``; ``future`` is true if ``stamp`` is too new.
        """
        with self.arrived:
            target, source = self._listen(target, source)
            return self._tree.lookup(target, source, stamp)

    def has_fixed(self, frame: str) -> bool:
        """Returns whether /tf_static has a child frame of ``frame``."""
        with self.arrived:
            return frame in self._fixed

    def latest(self, target: str, source: str) -> float:
        """Returns the newest stamp [s] at which the frames are connected (inf: static); raises DisconnectedError."""
        with self.arrived:
            target, source = self._listen(target, source)
            return self._tree.latest(target, source)

    def take(self, message: bytes) -> None:
        """Stores the watched transforms of a serialised message from /tf."""
        with self.arrived:
            picked = self._picker.pick(message)
            if picked:
                self._forget_if_time_jumped()
                self._insert([one for one in picked if self._is_timely(one)], static=False)

    def take_static(self, message: bytes) -> None:
        """Stores all transforms of a serialised message from /tf_static."""
        with self.arrived:
            records = transforms_of(message, self._warn)
            self._fixed.update(record.parent for record in records)
            self._insert(records, static=True)

    def watch(self) -> None:
        """Watches the edges between each pair of frames; if not yet connected, both chains up to their roots."""
        children: set[str] = set()
        for target, source in self._pairs:
            try:
                children.update(*self._tree.path(target, source))
            except DisconnectedError:
                children.update(self._tree.chain(target), self._tree.chain(source))
        self._picker.watch(children)

    def wake(self) -> None:
        """Wakes all threads that wait for ``arrived``."""
        with self.arrived:
            self.arrived.notify_all()

    def _listen(self, *frames: str) -> tuple[str, str]:
        """Records the pair (target, source); returns the frame names without leading slash."""
        target, source = pair = stripped(frames[0]), stripped(frames[1])
        for frame in pair:
            fault = frame_fault(frame)
            if fault:
                raise FrameNameError(f"no transform from {source!r} to {target!r}: {fault}")
        known = pair in self._pairs
        self._pairs.pop(pair, None)
        self._pairs[pair] = None
        if not known:
            if len(self._pairs) > _MOST_PAIRS:
                del self._pairs[next(iter(self._pairs))]
            self.watch()
        return pair

    def _is_timely(self, record: StampedTransform) -> bool:
        if self._clock.is_of_before(record.stamp):
            return False
        ahead = record.stamp - self._clock.now
        if ahead <= self._future_limit:
            return True
        if self._clock.now > 0.0:  # before the first /clock message, every stamp is far ahead
            self._warn(
                f"a transform from {record.parent!r} to {record.child!r} was dropped: it is stamped {ahead:.1f} s "
                f"ahead of the clock, more than ~transform_future_limit, {self._future_limit:g} s"
            )
        return False

    def _insert(self, records: list[StampedTransform], static: bool) -> None:
        changes = [self._tree.insert(*record, static=static) for record in records]
        if any(changes):
            self.watch()
        self.arrived.notify_all()

    def _forget_if_time_jumped(self) -> None:
        last, now = self._clock.now, self._now()
        if self._clock.jumped(now):
            self._warn(f"time jumped back from {last:.3f} to {now:.3f} s: transforms forgotten")
            self._tree.clear()
