"""Serves the fleet page with a stand-in for the base station."""

import functools
import os
import subprocess
import sys
import urllib.error
import urllib.request
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

from pioneer_harness.masters import Master
from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

TOKEN, VIEWER = "the-operators-token", "the-viewers-token-1"
START_UP = 180.0
STAND_IN = Path(__file__).parent / "stand_in.py"


def request(url, path="/", cookie="", data=None, context=None, **headers):
    """Sends an HTTP request; returns status, headers and body."""
    headers = {key.replace("_", "-"): value for key, value in headers.items()}
    if cookie:
        headers["Cookie"] = cookie
    wanted = urllib.request.Request(url + path, data, headers)
    try:
        with urllib.request.urlopen(wanted, timeout=20, context=context) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


def publish(fleet, topic, kind, value):
    """Publishes a message on the master of a served fleet."""
    command = ["rostopic", "pub", "-1", topic, kind, value]
    subprocess.run(
        command,
        env={**os.environ, **fleet.master.environment},
        check=True,
        capture_output=True,
        timeout=60,
    )


def login(url, token, context=None):
    """Logs in; returns the cookie of the new session."""
    status, headers, _ = request(url, "/login", data=token.encode(), context=context)
    assert status == 204
    return headers["Set-Cookie"].partition(";")[0]


def wait_for_page(url, check=lambda: None, context=None):
    """Waits until the server asks for a login; an exception from ``check`` ends the wait."""

    def answers():
        check()
        try:
            return request(url, context=context)[0] == 401
        except OSError:
            return False

    wait_until(answers, "the page's server", START_UP)


@contextmanager
def served(folder, robots=2, rate=100, parameters=(), scheme="http", context=None, variables=()):
    """Yields a page with ``parameters``, served for a stand-in with ``robots`` robots and odometry at ``rate``."""
    with Master() as master, PortReservation() as ports, ProcessGroup() as group:
        port = ports.take(18090)
        tokens = {"PIONEER_WEB_TOKEN": TOKEN, "PIONEER_WEB_VIEWER_TOKEN": VIEWER}
        environment = {**master.environment, **tokens, **dict(variables)}
        stand_in = [sys.executable, str(STAND_IN), str(robots), str(rate), "180"]
        group.start("robots", stand_in, environment, folder / "robots.log")
        page = [
            "rosrun",
            "pioneer_web",
            "fleet_page",
            f"_port:={port}",
            f"_recordings:={folder / 'recordings'}",
            *parameters,
        ]
        pid = group.start("page", page, environment, folder / "page.log")
        url = f"{scheme}://127.0.0.1:{port}"

        wait_for_page(url, group.check, context)

        def restart():
            group.kill("page")
            wait_until(lambda: not group.is_running("page"), "the end of the page", 30)
            group.start("page", page, environment, folder / "page.log")
            wait_for_page(url, group.check, context)

        yield SimpleNamespace(
            restart=restart, pid=pid,
            url=url, master=master, log=folder / "page.log", token=TOKEN, viewer=VIEWER,
            request=functools.partial(request, url, context=context),
            login=functools.partial(login, url, context=context),
        )  # fmt: skip
