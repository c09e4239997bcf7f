"""The service ``static_map`` is asked until it answers with a map."""

import pytest
import rospy

from nav_bundle.maps.conversions import GetMapArray, GetMapArrayResponse
from nav_bundle.maps.services import fetch_map


class Service:
    """The service; its answers in order, an exception for a failed request."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *answers: object) -> None:
        self._answers = list(answers)
        self.waits: list[float] = []
        self.warnings: list[str] = []
        self.ending = False
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(rospy, "loginfo", lambda *_: None)
        monkeypatch.setattr(rospy, "logwarn_throttle", lambda _, text: self.warnings.append(text))
        monkeypatch.setattr(rospy, "is_shutdown", lambda: self.ending)
        monkeypatch.setattr(rospy, "wait_for_service", lambda _: None)
        monkeypatch.setattr(rospy, "ServiceProxy", lambda _, kind: self._proxy(kind))
        monkeypatch.setattr(rospy.rostime, "wallsleep", self.waits.append)

    def _proxy(self, kind: object) -> object:
        assert kind is GetMapArray
        return self._answer

    def _answer(self) -> GetMapArrayResponse:
        answer = self._answers.pop(0)
        self.ending = not self._answers and isinstance(answer, Exception)
        if isinstance(answer, Exception):
            raise answer
        assert isinstance(answer, GetMapArrayResponse)
        return answer


def test_a_map_server_that_fails_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """One ServiceException used to end the thread, and amcl never got a map."""
    response = GetMapArrayResponse()
    failures = (rospy.ServiceException("no map yet"), rospy.ROSException("gone"))
    service = Service(monkeypatch, *failures, response)
    assert fetch_map() is response.map
    assert len(service.waits) == 2
    assert "no map yet" in service.warnings[0]


def test_a_node_that_ends_asks_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    service = Service(monkeypatch, rospy.ServiceException("shutting down"))
    assert fetch_map() is None
    assert service.warnings == []
