"""A parameter that outlives its node: written once at each change, and again where the master has not got it."""

import http.client
import itertools
import queue
from xml.parsers.expat import ExpatError

import pytest
import rospy

from pioneer_node.nodes import kept_parameter


class Master:
    """Keeps one parameter, with a name of its own: threads of earlier tests ask for theirs.

    ``fails`` makes the next call fail.
    """

    _numbers = itertools.count()

    def __init__(self, monkeypatch: pytest.MonkeyPatch, value: str = "") -> None:
        self.name = f"held_{next(self._numbers)}"
        self.value, self.fails = value, False
        self.error: Exception = OSError("the master has ended")
        self.writes: queue.SimpleQueue[str] = queue.SimpleQueue()
        monkeypatch.setattr(rospy, "get_param", self._get)
        monkeypatch.setattr(rospy, "set_param", self._set)
        monkeypatch.setattr(rospy, "logwarn", lambda *_: None)

    def _get(self, name: str, default: str) -> str:
        return self.value if name == self.name else default

    def _set(self, name: str, value: str) -> None:
        if name != self.name:
            return
        fails, self.fails = self.fails, False
        self.writes.put(value)
        if fails:
            raise self.error
        self.value = value


def test_a_value_is_read_at_the_start_and_written_once_at_each_change(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    master = Master(monkeypatch, "cancelled by /rviz")
    hold = kept_parameter.KeptParameter(master.name, "")
    assert hold.value == "cancelled by /rviz"
    for reason in ("cancelled by /rviz", "", "", "moved by hand"):
        hold.keep(reason)
    assert [master.writes.get(timeout=10.0) for _ in range(2)] == ["", "moved by hand"]
    assert master.writes.empty()


@pytest.mark.parametrize(
    "error", [OSError("it is away"), http.client.BadStatusLine(""), ExpatError("half an answer")]
)
def test_a_hold_that_could_not_be_written_is_written_later(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    """One failed write used to lose the stop for good, and some errors ended all writing."""
    monkeypatch.setattr(kept_parameter, "RETRY", 0.01)
    master = Master(monkeypatch)
    master.fails, master.error = True, error
    kept_parameter.KeptParameter(master.name, "").keep("cancelled by /rviz")
    assert [master.writes.get(timeout=10.0) for _ in range(2)] == ["cancelled by /rviz"] * 2


def test_a_master_that_fails_ends_no_later_write(monkeypatch: pytest.MonkeyPatch) -> None:
    master = Master(monkeypatch)
    master.fails = True
    hold = kept_parameter.KeptParameter(master.name, "")
    hold.keep("cancelled by /rviz")
    hold.keep("moved by hand")
    assert [master.writes.get(timeout=10.0) for _ in range(2)] == [
        "cancelled by /rviz",
        "moved by hand",
    ]


def test_a_restarted_master_gets_the_value_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot that was stopped drove on after its master and then its coordinator had been started again."""
    monkeypatch.setattr(kept_parameter, "CHECK", 0.01)
    master = Master(monkeypatch)
    hold = kept_parameter.KeptParameter(master.name, "")
    hold.keep("cancelled by /rviz")
    assert master.writes.get(timeout=10.0) == "cancelled by /rviz"
    for _ in range(2):
        master.value = ""
        assert master.writes.get(timeout=10.0) == "cancelled by /rviz"


def test_a_value_of_the_node_before_is_kept_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_parameter, "CHECK", 0.01)
    master = Master(monkeypatch, "moved by hand")
    kept_parameter.KeptParameter(master.name, "")
    master.value = ""
    assert master.writes.get(timeout=10.0) == "moved by hand"
