"""The fleet page with a stand-in for the base station, and a browser that shows it."""

import functools
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from page_driver import known
from served import TOKEN, served

from pioneer_harness.wait import wait_until

SHOTS = Path(__file__).resolve().parents[5] / ".setup" / "log" / "test" / "fleet-page"


@pytest.fixture(scope="package")
def fleet(tmp_path_factory):
    with served(tmp_path_factory.mktemp("page")) as one:
        yield one


@pytest.fixture(scope="package")
def driver():
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    for word in (
        "headless=new",
        "no-sandbox",
        "disable-gpu",
        "disable-dev-shm-usage",
        "window-size=1280,800",
    ):
        options.add_argument(f"--{word}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    options.binary_location = "/usr/bin/chromium"
    browser = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
    browser.set_script_timeout(30)
    yield browser
    browser.quit()


@pytest.fixture(autouse=True)
def console(request):
    """Fails a test in whose course a page has logged an error. A refused request is none."""
    if "driver" not in request.fixturenames:
        yield
        return
    driver = request.getfixturevalue("driver")
    yield
    errors = [
        line["message"]
        for line in driver.get_log("browser")
        if line["level"] == "SEVERE" and line["source"] != "network"
    ]
    assert errors == []


@pytest.fixture
def shot(driver):
    def save(name):
        SHOTS.mkdir(parents=True, exist_ok=True)
        driver.save_screenshot(str(SHOTS / f"{name}.png"))

    return save


@pytest.fixture
def opened(driver, fleet):
    """Opens the page once with the operator's token; returns a getter for the page's state, and the loading time."""
    state = functools.partial(known, driver)
    driver.get(f"{fleet.url}/#{TOKEN}")
    began = time.monotonic()
    wait_until(lambda: state("pioneer1.pose") and state("pioneer2.pose"), "both robots' poses", 60)
    return SimpleNamespace(state=state, took=time.monotonic() - began)
