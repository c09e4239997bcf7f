"""A recording on the fleet page, with a time slider."""

import re
import signal
import subprocess
import sys

import pytest
from page_driver import SOON, known, press
from selenium.webdriver.common.by import By
from served import START_UP

from pioneer_harness.wait import wait_until

pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)
SEEK = """const slider = document.querySelector("#replay input");
slider.value = arguments[0]; slider.dispatchEvent(new Event("change", {bubbles: true}))"""


@pytest.fixture
def recording(fleet, tmp_path):
    """Returns a recording of a few seconds with two robots."""
    path = tmp_path / "run.mcap"
    words = [
        sys.executable,
        "-m",
        "pioneer_fleet.recording.recorder",
        str(path),
        f"base={fleet.master.uri}",
    ]
    with subprocess.Popen(words) as recorder:
        try:
            wait_until(
                lambda: path.is_file() and path.stat().st_size > 300_000,
                "some seconds of recording",
                SOON,
            )
        finally:
            recorder.send_signal(signal.SIGTERM)
    assert recorder.returncode == 0
    return path


@pytest.fixture
def address(recording):
    words = [sys.executable, "-m", "pioneer_fleet.recording.replay", "--web", str(recording)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as replay:
        try:
            said = next(line for line in replay.stdout if "Fleet page" in line)
            yield re.search(r"http://\S+", said)[0]
        finally:
            replay.send_signal(signal.SIGTERM)


def test_a_recording_is_played_from_where_the_slider_is_put(driver, address, shot):
    def opened():
        driver.get(address)
        return driver.find_elements(By.ID, "token") or driver.find_elements(By.ID, "map")

    def position():
        return (known(driver, "replay") or [-1.0])[0]

    wait_until(lambda: answers(opened), "the page's server", START_UP)
    wait_until(
        lambda: known(driver, "pioneer1.pose") and known(driver, "pioneer2.pose"),
        "both robots",
        SOON,
    )
    length = wait_until(lambda: known(driver, "replay"), "the slider", SOON)[1]
    assert driver.find_element(By.CSS_SELECTOR, "#replay input").is_displayed()
    wait_until(lambda: position() >= length - 1, "the end", SOON)
    press(driver, "simulate-pause")
    wait_until(
        lambda: "simulator: pause" in driver.find_element(By.ID, "answers").text, "the pause", SOON
    )
    driver.execute_script(SEEK, 1.0)
    wait_until(lambda: position() == 1.0, "the place of the slider", SOON)
    shot("replay")


def answers(open_page):
    from selenium.common.exceptions import WebDriverException

    try:
        return open_page()
    except WebDriverException:
        return False
