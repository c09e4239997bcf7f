"""Odd messages on any topic cost their own values: pages keep showing the others."""

import os
import subprocess
import sys
from pathlib import Path

import orjson
import pytest
from served import served
from websockets.sync.client import connect

from pioneer_harness.wait import wait_until

HERE = Path(__file__).resolve().parent
HOSTILE = HERE.parents[2] / "pioneer_demo" / "test" / "fuzz"
SECONDS = 6
UPDATE = 2.0
"""Maximum time between two changes on a page [s]; five a second are usual."""

pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


@pytest.mark.parametrize("seed", [1, 2])
def test_no_odd_message_freezes_the_page(tmp_path, seed):
    with served(tmp_path) as fleet:
        url = fleet.url.replace("http", "ws") + "/live"
        cookie = fleet.login(fleet.viewer)
        with connect(
            url, additional_headers={"Cookie": cookie}, max_size=None, open_timeout=30
        ) as page:
            while b"pioneer2.scan" not in page.recv(30):
                pass
            path = f"{HOSTILE}:{os.environ.get('PYTHONPATH', '')}"
            environment = {**os.environ, **fleet.master.environment, "PYTHONPATH": path}
            command = [sys.executable, str(HERE / "odd_messages.py"), str(seed), str(SECONDS)]
            with subprocess.Popen(
                command, env=environment, stdout=subprocess.PIPE, text=True
            ) as sender:
                while sender.poll() is None:
                    orjson.loads(page.recv(UPDATE))
                topics, count = map(int, sender.stdout.read().split())
            assert topics > 20
            assert count > 20 * topics
        _await_normal(url, cookie)
        log = fleet.log.read_text()
        assert "Traceback" not in log
        assert "bad callback" not in log


def _await_normal(url, cookie):
    """Waits until a new page shows a robot as it is."""

    def is_normal():
        with connect(
            url, additional_headers={"Cookie": cookie}, max_size=None, open_timeout=30
        ) as page:
            values = orjson.loads(page.recv(30))
        pose, scan = values["pioneer1.pose"], values["pioneer1.scan"]
        return pose and max(map(abs, pose)) < 10 and scan and 100 < max(scan[2]) < 2000

    wait_until(is_normal, "pioneer1 as it is", 30)
