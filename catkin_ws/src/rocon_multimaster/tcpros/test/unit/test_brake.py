"""When a stream is held back, and when it is not."""

from types import SimpleNamespace

from tcpros.adapters.brake import Brake


class Clock:
    """A reactor whose timers fire when the test moves its clock."""

    def __init__(self) -> None:
        self._due = None

    def call_later(self, _seconds, call):
        self._due = call
        return SimpleNamespace(cancel=lambda: None)

    def pass_time(self) -> None:
        """Lets the time pass that the brake waits between two looks."""
        due, self._due = self._due, None
        due()


def test_a_receiver_that_takes_something_again_is_waited_for_at_once() -> None:
    """It was not for up to a second, and a publisher without pauses lost messages to somebody who took them."""
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
