"""Waiting for a ROS master."""

from typing import Any

import pytest

from pioneer_gazebo.fleet import session


class BusyMaster:
    """A master that answers once, then refuses a connection, then has its run id."""

    master_uri = "http://localhost:1"

    def __init__(self, _name: str) -> None:
        self.answers: list[Any] = [ConnectionRefusedError(), False, True]

    def getPid(self) -> int:
        return 1

    def hasParam(self, _name: str) -> bool:
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return bool(answer)


def test_a_master_that_refuses_a_connection_for_a_moment_is_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    master = BusyMaster("")
    monkeypatch.setattr(session.rosgraph, "Master", lambda _name: master)
    session.Session("test").wait_for_master()
    assert not master.answers
