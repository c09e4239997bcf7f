"""When a stream is held back, and when it is not."""

from types import SimpleNamespace

from tcpros.brake import Brake


class Clock:
    """A reactor whose timers fire when the test advances its clock."""

    def __init__(self) -> None:
        self._due = None

    def call_later(self, _seconds, call):
        self._due = call
        return SimpleNamespace(cancel=lambda: None)

    def pass_time(self) -> None:
        """Advances the clock by the brake's interval between two checks."""
        due, self._due = self._due, None
        due()


def test_a_receiver_that_takes_something_again_is_waited_for_at_once() -> None:
    """For up to a second the brake did not wait for it, so it lost messages of a publisher without pauses."""
    taken = [0]
    clock, fanout = Clock(), SimpleNamespace(acknowledged=lambda: taken[0], relieved=None)
    brake = Brake(clock, fanout, 1e9, lambda: None)
    brake.apply()
    assert brake.is_on
    for _ in range(2):
        clock.pass_time()
    brake.apply()
    assert not brake.is_on, "nobody takes anything"
    taken[0] += 1
    brake.apply()
    assert brake.is_on
