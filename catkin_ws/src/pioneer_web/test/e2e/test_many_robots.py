"""Fifteen robots: all of them are shown, so is one that joins later, and the stream to a page stays small."""

import functools
import json
import time

import pytest
from page_driver import known, shown
from selenium.webdriver.common.by import By
from served import publish, served
from websockets.sync.client import connect

from pioneer_harness.wait import wait_until

pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)
COUNT, SOON = 15, 60.0
NAMES = [f"pioneer{number}" for number in range(1, COUNT + 1)]
ROUNDS = 20
"""Number of waypoints of a robot, 10 m apart."""
WATCHED = 3.0
"""How long the stream's bytes are counted [s]."""
MOST_BYTES = 200_000
"""Limit for the stream to one page [bytes/s]."""


@pytest.fixture(scope="module")
def fifteen(tmp_path_factory):
    with served(tmp_path_factory.mktemp("page"), COUNT, rate=20) as one:
        yield one


def drives(socket, name):
    """Sends a robot to and fro, so that it has plan and costmap to the end; returns whether it can be reached yet."""
    for number in range(ROUNDS):
        place = {"x": 5.0 * (-1) ** number, "y": 0.0, "append": number > 0}
        socket.send(json.dumps({"do": "drive", "robots": [name], **place}))
        while not isinstance(frame := socket.recv(SOON), str):
            pass
        if not json.loads(frame)["answer"]["good"]:
            return False
    return True


def test_fifteen_robots_are_on_the_map_and_in_the_table(fifteen, driver, shot):
    driver.get(f"{fifteen.url}/#{fifteen.token}")
    wait_until(lambda: shown(driver) == NAMES, "all robots on the map", SOON)
    wait_until(lambda: all(known(driver, f"{name}.scan") for name in NAMES), "a scan of each", SOON)
    wait_until(
        lambda: len(driver.execute_script("return fleetPage.labels()")) == COUNT, "the labels", SOON
    )
    faults = [known(driver, f"{name}.row")["fault"] for name in NAMES]
    assert faults == [""] * COUNT
    shot("fifteen")
    driver.get("about:blank")


def test_a_page_of_fifteen_robots_that_drive_gets_at_most_200_kb_a_second(fifteen, record_property):
    cookie = fifteen.login(fifteen.token)
    url = fifteen.url.replace("http", "ws") + "/live"
    with connect(url, additional_headers={"Cookie": cookie}, max_size=None) as socket:
        for name in NAMES:
            wait_until(functools.partial(drives, socket, name), f"{name} under way", SOON)
        state = {}
        while not all(state.get(f"{name}.costs") for name in NAMES):
            state.update(json.loads(socket.recv(SOON)))
        began, size = time.monotonic(), 0
        while time.monotonic() < began + WATCHED:
            size += len(socket.recv(SOON))
        rate = size / (time.monotonic() - began)
        record_property("to a page [byte/s]", rate)
        assert rate <= MOST_BYTES


def test_a_robot_that_joins_is_shown_on_a_page_that_is_open_and_can_be_sent(fifteen, driver):
    driver.get(f"{fifteen.url}/#{fifteen.token}")
    wait_until(lambda: shown(driver) == NAMES, "all robots on the map", SOON)
    publish(fifteen, "/stand_in/join", "std_msgs/Empty", "{}")
    wait_until(lambda: shown(driver) == [*NAMES, "pioneer16"], "the one that joined", SOON)
    wait_until(
        lambda: driver.find_elements(By.CSS_SELECTOR, '[data-robot="pioneer16"]'), "its row", SOON
    )
    with connect(
        fifteen.url.replace("http", "ws") + "/live",
        additional_headers={"Cookie": fifteen.login(fifteen.token)},
        max_size=None,
    ) as socket:
        wait_until(lambda: drives(socket, "pioneer16"), "it under way", SOON)
    wait_until(lambda: known(driver, "pioneer16.plan"), "its plan", SOON)
    # A value that is not a list of names adds no robot and breaks nothing.
    for value in (5, ["no name", 7], {"pioneer1": "x"}):
        fifteen.master.set_param("/robot_names", value)
    clock = known(driver, "time")
    wait_until(lambda: known(driver, "time") > clock + 1.0, "the page as before", SOON)
    assert shown(driver) == [*NAMES, "pioneer16"]
    driver.get("about:blank")
