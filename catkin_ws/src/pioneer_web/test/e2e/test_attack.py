"""What viewers and unauthenticated clients do must not delay an operator's STOP."""

import contextlib
import json
import multiprocessing
import os
import socket
import threading
import time
from urllib.parse import urlsplit

import pytest
from foxglove_client import advertise, foxglove_client
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait
from served import VIEWER, served
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from pioneer_harness.wait import wait_until

pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

STOP = 0.3
"""Maximum time from an operator's STOP to its answer, which follows the zero commands, under attack [s]."""
STOPS = 20
CLICKS = 40
DOCTOR = "//button[contains(., 'Ask the doctor')]"


@pytest.fixture(scope="module")
def target(tmp_path_factory):
    """A page on whose Python path there is a module that never finishes its import."""
    folder = tmp_path_factory.mktemp("attack")
    modules = folder / "modules"
    modules.mkdir()
    (modules / "hangs.py").write_text(
        "import threading\nprint('imported', flush=True)\nthreading.Event().wait()\n"
    )
    path = f"{modules}:{os.environ.get('PYTHONPATH', '')}"
    with served(folder, variables={"PYTHONPATH": path}) as fleet:
        yield fleet


@contextlib.contextmanager
def operator(fleet):
    """Yields a function that sends a command and returns the time until its answer [s]; zeros precede that of STOP."""
    url = fleet.url.replace("http", "ws") + "/live"
    with connect(
        url, additional_headers={"Cookie": fleet.login(fleet.token)}, max_size=None, open_timeout=30
    ) as live:

        def ask(do):
            began = time.monotonic()
            live.send(json.dumps({"do": do, "robots": ["pioneer1"]}))
            while not isinstance(frame := live.recv(30), str):
                pass
            assert json.loads(frame)["answer"]["good"]
            return time.monotonic() - began

        yield ask


def slowest_stop(ask):
    """Returns the longest time of many STOPs [s]."""
    times = []
    for _ in range(STOPS):
        times.append(ask("stop"))
        ask("release")
    return max(times)


@contextlib.contextmanager
def repeated(*actions):
    """Repeats each action in a thread of another process until the end."""
    process = multiprocessing.get_context("fork").Process(
        target=_repeat_all, args=(actions,), daemon=True
    )
    process.start()
    try:
        yield
        assert process.is_alive()
    finally:
        process.kill()
        process.join()


def _repeat_all(actions):
    threads = [threading.Thread(target=_repeat, args=(action,)) for action in actions]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def _repeat(action):
    while True:
        with contextlib.suppress(OSError, EOFError, WebSocketException):
            action()


def test_the_name_of_a_message_type_imports_no_module(target):
    for token in (target.viewer, target.token):
        with foxglove_client(target.url, token) as client:
            for number, kind in enumerate(
                ("hangs/X", "hangs", "os/path", "std_msgs/__loader__", "../hangs/X", "a/b/c")
            ):
                advertise(client, number, "/pioneer1/x", kind)
                status = client.await_op("status")["message"]
                assert "read-only" in status or "cannot publish" in status
    with operator(target) as ask:
        assert slowest_stop(ask) <= STOP
    assert "imported" not in target.log.read_text()


def test_viewers_who_ask_the_doctor_do_not_delay_a_stop(target, driver):
    driver.get(f"{target.url}/#{VIEWER}")
    WebDriverWait(driver, 60).until(lambda _: driver.find_elements(By.ID, "tab-network"))[0].click()
    button = WebDriverWait(driver, 60).until(lambda _: driver.find_elements(By.XPATH, DOCTOR))[0]
    with operator(target) as ask:
        driver.execute_script(
            "for (let i = 0; i < arguments[1]; i++) arguments[0].click()", button, CLICKS
        )
        assert slowest_stop(ask) <= STOP
        wait_until(
            lambda: driver.find_elements(By.CSS_SELECTOR, ".finding"), "the doctor's findings", 90
        )


def test_viewers_who_flood_the_server_do_not_delay_a_stop(target):
    cookie = target.login(target.viewer)
    words = json.dumps(
        {"op": "subscribe", "subscriptions": [{"id": n, "channelId": 1} for n in range(5000)]}
    )
    frame = json.dumps({"do": "drive", "robots": ["pioneer1"] * 1000, "x": 0, "y": 0})

    def chat(path, text):
        url = target.url.replace("http", "ws") + path
        with connect(
            url, additional_headers={"Cookie": cookie}, max_size=None, open_timeout=30
        ) as socket_:
            for _ in range(200):
                socket_.send(text)

    attacks = [lambda: target.request("/", cookie=cookie)] * 4
    attacks += [lambda: target.request("/metrics", cookie=cookie)] * 2
    attacks += [lambda: chat("/foxglove", words)] * 2
    attacks += [lambda: chat("/live", frame)] * 2
    with operator(target) as ask, repeated(*attacks):
        assert slowest_stop(ask) <= STOP


def test_unfinished_requests_do_not_delay_a_stop_or_keep_others_out(target):
    parts = urlsplit(target.url)

    def half_open():
        with contextlib.ExitStack() as stack:
            for _ in range(300):
                connection = stack.enter_context(
                    socket.create_connection((parts.hostname, parts.port), 5)
                )
                connection.sendall(b"GET / HTTP/1.1\r\nHost: x\r\nX-")

    with operator(target) as ask, repeated(half_open, half_open):
        assert slowest_stop(ask) <= STOP
        wait_until(lambda: _status(target) == 200, "an answer to another client", 20)


def _status(target):
    try:
        return target.request("/metrics", Authorization=f"Bearer {target.viewer}")[0]
    except OSError:
        return 0
