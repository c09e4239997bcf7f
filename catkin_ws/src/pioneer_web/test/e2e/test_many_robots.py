"""Fifteen robots: a page gets all of them, and its stream stays small."""

import json
import time

import pytest
from served import served
from websockets.sync.client import connect

pytestmark = pytest.mark.filterwarnings("ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning")
COUNT, SOON = 15, 60.0
WATCHED = 3.0
"""How long the stream is counted [s]."""
MOST_BYTES = 200_000
"""A second, to one page."""


@pytest.fixture(scope="module")
def fifteen(tmp_path_factory):
    with served(tmp_path_factory.mktemp("page"), COUNT, rate=20) as one:
        yield one


def test_a_page_of_fifteen_robots_gets_at_most_200_kb_a_second(fifteen, record_property):
    cookie = fifteen.login(fifteen.viewer)
    url = fifteen.url.replace("http", "ws") + "/live"
    with connect(url, additional_headers={"Cookie": cookie}, max_size=None) as socket:
        state = {}
        while not all(state.get(f"pioneer{number}.scan") for number in range(1, COUNT + 1)):
            state.update(json.loads(socket.recv(SOON)))
        began, size = time.monotonic(), 0
        while time.monotonic() < began + WATCHED:
            size += len(socket.recv(SOON))
        rate = size / (time.monotonic() - began)
        record_property("to a page [byte/s]", rate)
        assert rate <= MOST_BYTES
