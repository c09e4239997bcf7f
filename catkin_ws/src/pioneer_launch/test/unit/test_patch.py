"""Patches of ROS's own Python packages, each in an interpreter of its own."""

import subprocess
import sys
from pathlib import Path

import pytest

OVERTAKEN = """
import threading
import rospy
from rospy.impl.registration import RegManager
from pioneer_launch.patch import keep_publisher_updates
keep_publisher_updates()
connected = threading.Event()
class Handler:
    done = False
    def _connect_topic(self, topic, uri):
        connected.set()
        return 1, "", 1
manager = RegManager(Handler())
manager.publisher_update("/topic", ["http://localhost:1/"])  # the master's update, which has overtaken ...
manager.publisher_update("/topic", [])  # ... its answer to the subscription
threading.Thread(target=manager.run, daemon=True).start()
assert connected.wait(20)
"""


def test_a_publisher_that_registers_during_a_subscription_is_connected() -> None:
    assert subprocess.run([sys.executable, "-c", OVERTAKEN], check=False).returncode == 0


MASTER = """
import threading, time
from rosmaster.threadpool import MarkedThreadPool
from pioneer_launch.patch import wake_master_workers
wake_master_workers()
pool, began, order = MarkedThreadPool(3), time.monotonic(), []
for _ in range(200):
    done = threading.Event()
    pool.queue_task(None, done.set, ())
    assert done.wait(20)
other = MarkedThreadPool(3)
for _ in range(20):
    for one in (pool, other):
        done = threading.Event()
        one.queue_task(None, done.set, ())
        assert done.wait(20)
print(time.monotonic() - began)
first, last = threading.Event(), threading.Event()
pool.queue_task("api", lambda: (first.wait(20), order.append("first")), ())
pool.queue_task("api", lambda: (order.append("second"), last.set()), ())
first.set()
assert last.wait(20) and order == ["first", "second"]
"""


def test_master_does_its_work_at_once_and_in_order() -> None:
    """240 tasks in sequence: with ROS's own workers, which poll 10 times a second, they take 7 s.

    With two masters in one process, their workers used to take each other's notifications, and a task waited up to 1 s.
    """
    done = subprocess.run(
        [sys.executable, "-c", MASTER], check=True, capture_output=True, text=True
    )
    assert float(done.stdout) < 3.0


TELLING = """
import threading, time
from pioneer_launch.patch import tell_registrations
tell_registrations()
from rosmaster.master_api import ROSMasterHandler
master = ROSMasterHandler()
assert master.awaitRegistrations("/me", 1, 0.0) == (1, "registrations", 0)
told = []
asking = threading.Thread(target=lambda: told.append(master.awaitRegistrations("/me", 0, 60.0)))
asking.start()
master.registerPublisher("/talker", "/chatter", "std_msgs/String", "http://127.0.0.1:1/")
asking.join(20.0)
assert told == [(1, "registrations", 1)], told
assert dict(master.getTopicTypes("/me")[2]) == {"/chatter": "std_msgs/String"}
master.unregisterPublisher("/talker", "/chatter", "http://127.0.0.1:1/")
assert master.awaitRegistrations("/me", 1, 60.0)[2] == 2
"""


def test_master_tells_at_once_that_somebody_registered() -> None:
    assert subprocess.run([sys.executable, "-c", TELLING], check=False, timeout=60).returncode == 0


SERVING = """
import contextlib, threading, xmlrpc.client
from rosgraph.xmlrpc import XmlRpcHandler, XmlRpcNode
from pioneer_launch.patch import stop_serving_at_shutdown
stop_serving_at_shutdown()
ready = threading.Event()
class Handler(XmlRpcHandler):
    def _ready(self, uri):
        ready.set()
node = XmlRpcNode(0, Handler())
serving = threading.Thread(target=node.run, daemon=True)
serving.start()
assert ready.wait(20)
with contextlib.suppress(xmlrpc.client.Fault):
    xmlrpc.client.ServerProxy(node.uri).unknown()
node.shutdown("end of the test")
serving.join(20)
assert not serving.is_alive()
"""


def test_thread_that_serves_requests_ends_at_shutdown() -> None:
    """With rospy's own shutdown, the thread keeps calling accept() on the closed socket in a busy loop."""
    done = subprocess.run(
        [sys.executable, "-c", SERVING], check=False, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, "")


VERSIONS = """
import subprocess
from roslaunch.loader import Loader
from pioneer_launch.patch import read_versions_here
commands = ["rosversion roslaunch", "rosversion -d"]
def values():
    return [Loader().param_value(False, "name", "auto", None, None, None, command) for command in commands]
before = values()
read_versions_here()
started = []
subprocess.Popen = lambda *words, **_: started.append(words)
assert values() == before, (values(), before)
assert not started
assert Loader().param_value(False, "name", "int", "3", None, None, None) == 3
"""
NO_VERSION = """
from roslaunch.loader import Loader
from pioneer_launch.patch import read_versions_here
read_versions_here()
try:
    Loader().param_value(False, "name", "auto", None, None, None, "rosversion none_such")
except ValueError as error:
    assert "returned with code" in str(error)
else:
    raise AssertionError
"""


@pytest.mark.parametrize("code", [VERSIONS, NO_VERSION], ids=["versions", "none"])
def test_versions_of_ros_are_read_without_an_interpreter_for_each(code: str) -> None:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_launchers_share_no_setuptools() -> None:
    code = (
        "import sys; from pioneer_launch import launcher; launcher._import_shared()\n"
        "assert 'rosclean' in sys.modules; sys.exit('setuptools' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == (
        sys.version_info >= (3, 12)
    )


PACKAGES = """
import os, sys
from pathlib import Path
from pioneer_launch.patch import remember_packages
folder = Path(sys.argv[1])
os.environ["ROS_PACKAGE_PATH"] = f"{folder / 'first'}:{folder / 'second'}"
def add(where, name):
    (folder / where / name).mkdir(parents=True)
    (folder / where / name / "package.xml").write_text(f"<package><name>{name}</name></package>")
for where, name in (("first", "both"), ("second", "both"), ("second", "one")):
    add(where, name)
import rospkg
searches, search = [], rospkg.rospack.list_by_path
rospkg.rospack.list_by_path = lambda *words: (searches.append(words[1]), search(*words))
remember_packages()
for _ in range(3):
    assert rospkg.RosPack().get_path("both") == str(folder / "first/both")
    assert rospkg.RosPack().get_path("one") == str(folder / "second/one")
assert sorted(searches) == sorted({*searches}), searches
add("first", "late")
assert rospkg.RosPack().get_path("late") == str(folder / "first/late")
try:
    rospkg.RosPack().get_path("never")
except rospkg.ResourceNotFound as error:
    assert "never" in str(error)
else:
    sys.exit("found")
"""


def test_folders_of_packages_are_searched_once_but_for_new_packages(tmp_path: Path) -> None:
    assert subprocess.run([sys.executable, "-c", PACKAGES, tmp_path], check=False).returncode == 0


BOMB = """
import time, threading, xmlrpc.client
import rosmaster.master
master = rosmaster.master.Master(port=0)
master.start()
uri = master.uri
entities = "".join(
    f'<!ENTITY {name} "{8 * f"&{before};"}">' for before, name in zip("abcdef", "bcdefg")
)
body = (
    f'<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "ha">{entities}]><methodCall>'
    "<methodName>getPid</methodName><params><param><value>&g;</value></param></params></methodCall>"
).encode()
import urllib.request
request = urllib.request.Request(uri, body, {"Content-Type": "text/xml"})
began = time.process_time()
answer = urllib.request.urlopen(request, timeout=20).read()
print("used", time.process_time() - began)
assert b"EntitiesForbidden" in answer, answer
code, _, pid = xmlrpc.client.ServerProxy(uri).getPid("/test")
assert code == 1 and pid
import os; os._exit(0)
"""


def test_a_master_refuses_documents_with_entities_and_serves_others() -> None:
    """ROS' own masters and nodes do, by defusedxml: no patch is needed."""
    done = subprocess.run([sys.executable, "-c", BOMB], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[1]) < 0.1
