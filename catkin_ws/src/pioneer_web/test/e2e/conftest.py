"""The fleet page on a stand-in for the base station, and a browser to look at it."""

import functools
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import pytest

from pioneer_harness.masters import Master
from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

TOKEN, VIEWER = "the-operators-token", "the-viewers-token-1"
START_UP = 180.0
STAND_IN = Path(__file__).parent / "stand_in.py"
SHOTS = Path(__file__).resolve().parents[5] / ".setup" / "log" / "test" / "fleet-page"


def request(url, path="/", cookie="", data=None, **headers):
    """Returns status, headers and body."""
    headers = {key.replace("_", "-"): value for key, value in headers.items()}
    if cookie:
        headers["Cookie"] = cookie
    wanted = urllib.request.Request(url + path, data, headers)
    try:
        with urllib.request.urlopen(wanted, timeout=20) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


def login(url, token):
    """Returns the cookie of a new session."""
    status, headers, _ = request(url, "/login", data=token.encode())
    assert status == 204
    return headers["Set-Cookie"].partition(";")[0]


@pytest.fixture(scope="package")
def fleet(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    with Master() as master, PortReservation() as ports, ProcessGroup() as group:
        port = ports.take(18090)
        tokens = {"PIONEER_WEB_TOKEN": TOKEN, "PIONEER_WEB_VIEWER_TOKEN": VIEWER}
        environment = {**master.environment, **tokens}
        group.start("robots", [sys.executable, str(STAND_IN), "2", "100", "180"], environment, folder / "robots.log")
        page = ["rosrun", "pioneer_web", "fleet_page", f"_port:={port}"]
        group.start("page", page, environment, folder / "page.log")
        url = f"http://127.0.0.1:{port}"

        def answers():
            group.check()
            try:
                return request(url)[0] == 401
            except OSError:
                return False

        wait_until(answers, "the page's server", START_UP)
        yield SimpleNamespace(
            url=url, master=master, log=folder / "page.log", token=TOKEN, viewer=VIEWER,
            request=functools.partial(request, url), login=functools.partial(login, url),
        )  # fmt: skip


@pytest.fixture(scope="package")
def driver():
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    for word in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "window-size=1280,800"):
        options.add_argument(f"--{word}")
    options.binary_location = "/usr/bin/chromium"
    browser = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
    browser.set_script_timeout(30)
    yield browser
    browser.quit()


@pytest.fixture
def shot(driver):
    def save(name):
        SHOTS.mkdir(parents=True, exist_ok=True)
        driver.save_screenshot(str(SHOTS / f"{name}.png"))

    return save


@pytest.fixture
def opened(driver, fleet):
    """Opens the page with the operator's token, once; returns what is known in the page, by name."""

    def state(name):
        return driver.execute_script("return window.fleetPage ? fleetPage.state[arguments[0]] : null", name)

    driver.get(f"{fleet.url}/#{TOKEN}")
    began = time.monotonic()
    wait_until(lambda: state("pioneer1.pose") and state("pioneer2.pose"), "both robots' poses", 60)
    return SimpleNamespace(state=state, took=time.monotonic() - began)
