"""How nodes shut down."""

import os
import re
import signal
import socket
import subprocess
import sys

import pytest
from rosgraph.network import encode_ros_handshake_header

from pioneer_harness.masters import Master
from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until

SHUT_DOWN = """
import rospy
from pioneer_node.nodes import entry

def woken():
    print("is_shutdown", rospy.is_shutdown(), flush=True)

entry.on_shutdown(woken)
rospy.signal_shutdown("test")
"""


def test_a_loop_that_is_woken_at_shutdown_sees_the_shutdown():
    # rospy.on_shutdown runs callbacks before it sets the flag: on a loaded machine amcl and others then slept forever.
    done = subprocess.run(
        [sys.executable, "-c", SHUT_DOWN], capture_output=True, text=True, timeout=60, check=True
    )
    assert "is_shutdown True" in done.stdout


LOSES_ITS_MASTER = """
import os, signal, sys
import rospy
from pioneer_node.nodes import entry

rospy.init_node = lambda *_, **__: None

class Node:
    def spin(self):
        if "asked" in sys.argv:
            os.kill(os.getpid(), signal.SIGINT)
        raise ConnectionRefusedError("no master")

raise SystemExit(entry.run("node", Node))
"""


@pytest.mark.parametrize(("asked", "status"), [("asked", 0), ("", 1)])
def test_a_node_that_lost_its_master_shuts_down_without_a_traceback(
    asked: str, status: int
) -> None:
    """A waypoint client that was reconnecting used to print one. Without a shutdown request it is still an error."""
    command = [sys.executable, "-c", LOSES_ITS_MASTER, asked]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == status
    assert ("Traceback" in done.stdout + done.stderr) == bool(status)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_finds_no_master_ends_when_asked_to(number: int) -> None:
    code = "from pioneer_node.nodes import entry; raise SystemExit(entry.run('node', object))"
    environment = {**os.environ, "ROS_MASTER_URI": "http://127.0.0.1:1", "PYTHONUNBUFFERED": "1"}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(
        [sys.executable, "-c", code], env=environment, text=True, **streams
    ) as process:
        try:
            assert process.stdout
            assert "Unable to register" in process.stdout.readline()
            process.send_signal(number)
            said = process.communicate(timeout=START)[1]
        finally:
            process.kill()
    assert process.returncode == 0
    assert "ended while registering with the ROS master at http://127.0.0.1:1" in said


SIGNAL_WHILE_A_THREAD_IS_JOINED = """
import os, signal, sys, threading
import rospy
from pioneer_node.nodes import entry

rospy.init_node = lambda *_, **__: None

class Node:
    def spin(self):
        # Thread.join holds this lock for a moment; here the signal arrives within it.
        with threading._shutdown_locks_lock:
            os.kill(os.getpid(), signal.SIGTERM)
        while not rospy.is_shutdown():
            rospy.rostime.wallsleep(0.01)

raise SystemExit(entry.run("node", Node))
"""


def test_a_node_with_private_parameters_waits_for_its_master(tmp_path) -> None:
    """rospy sets those parameters once, at once: a fleet page that was started too early ended with a traceback."""
    code = (
        "import rospy\nfrom pioneer_node.nodes import entry\n"
        "class Node:\n    def spin(self): print('port', rospy.get_param('~port'), flush=True)\n"
        "raise SystemExit(entry.run('node', Node))"
    )
    log = tmp_path / "node.log"
    with PortReservation() as ports, ProcessGroup() as group:
        port = ports.take(21311)
        environment = {**os.environ, "ROS_MASTER_URI": f"http://127.0.0.1:{port}"}
        group.start("node", [sys.executable, "-c", code, "_port:=7"], environment, log, True)
        wait_until(lambda: "waiting for the ROS master" in log.read_text(), "its line", START)
        with Master(port):
            wait_until(lambda: "port 7" in log.read_text(), "its parameter", START)


LOGS_AND_PRINTS = """
import sys
import rospy
from pioneer_node.nodes import entry

class Node:
    def spin(self):
        for _ in range(500):
            rospy.loginfo("a line")
        rospy.logerr("a line")
        print("a line", flush=True)

raise SystemExit(entry.run("node", Node))
"""


@pytest.mark.parametrize("output", ["full disk", "no reader"])
def test_a_rospy_node_survives_log_lines_that_cannot_be_written(output: str) -> None:
    """A full disk below its output ended move_base: rospy's handler raises into the thread that logs."""
    if output == "full disk":
        stream = os.open("/dev/full", os.O_WRONLY)
    else:
        reader, stream = os.pipe()
        os.close(reader)
    with Master() as master:
        done = subprocess.run(
            [sys.executable, "-c", LOGS_AND_PRINTS],
            env={**os.environ, **master.environment},
            stdout=stream,
            stderr=stream,
            timeout=60,
            check=False,
        )
    os.close(stream)
    assert done.returncode == 0


def test_a_signal_while_the_main_thread_joins_another_ends_the_node() -> None:
    """The handler used to start a thread, and deadlocked on a lock held by the main thread that it had interrupted."""
    command = [sys.executable, "-c", SIGNAL_WHILE_A_THREAD_IS_JOINED]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


TAKES_LONG_TO_TAKE_APART = """
import atexit, sys, time
import rospy
from pioneer_node.nodes import entry

atexit.register(time.sleep, 60)

class Node:
    def spin(self):
        sys.stdout.write("ready\\n")
        rospy.spin()
        sys.stdout.write("closed")

raise SystemExit(entry.run("node", Node))
"""


def test_a_node_that_was_asked_to_end_leaves_without_taking_python_apart() -> None:
    """Finalizing Python costs a node with numba and scipy 0.15 s of CPU; on a busy machine it then needed SIGTERM."""
    with Master() as master, ProcessGroup() as group:
        log = master.home / "node.log"
        node = group.start(
            "node", [sys.executable, "-c", TAKES_LONG_TO_TAKE_APART], master.environment, log, True
        )
        wait_until(lambda: "ready" in log.read_text(), "the node", START)
        os.kill(node, signal.SIGINT)
        wait_until(lambda: not group.is_running("node"), "its end", START)
        assert log.read_text().endswith("closed")
        assert group.deaths == ()


SERVES = """
import resource, signal
import rospy
from pioneer_node.nodes import entry
from std_srvs.srv import Trigger, TriggerResponse

files = []

def use_up(*_):
    resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
    try:
        while True:
            files.append(open("/dev/null"))
    except OSError:
        print("used up", flush=True)

class Node:
    def __init__(self):
        signal.signal(signal.SIGUSR1, use_up)
        signal.signal(signal.SIGUSR2, lambda *_: [file.close() for file in files])
        self.service = rospy.Service("answer", Trigger, lambda request: TriggerResponse(True, ""))
        print(self.service.uri, flush=True)

raise SystemExit(entry.run("server", Node))
"""


def test_a_server_that_ran_out_of_file_descriptors_serves_again() -> None:
    """Its accept thread used to die with a traceback; the node stayed registered but answered no requests."""
    with Master() as master, ProcessGroup() as group:
        log = master.home / "server.log"
        server = group.start(
            "server", [sys.executable, "-u", "-c", SERVES], master.environment, log
        )
        host, port = wait_until(
            lambda: re.search(r"rosrpc://(.*):(\d+)", log.read_text()), "its port", START
        ).groups()
        os.kill(server, signal.SIGUSR1)
        wait_until(lambda: "used up" in log.read_text(), "its last file", 10)
        with socket.create_connection((host, int(port))) as client:
            # The pending accept() has reserved a descriptor and uses it here; the next call finds none.
            header = {"callerid": "/client", "service": "/answer", "md5sum": "*", "persistent": "1"}
            client.sendall(encode_ros_handshake_header(header))
            wait_until(lambda: "out of file descriptors" in log.read_text(), "its error", 10)
        os.kill(server, signal.SIGUSR2)
        command = ["rosservice", "call", "/answer"]
        done = subprocess.run(
            command, env=master.environment, capture_output=True, text=True, timeout=60, check=False
        )
        assert "success: True" in done.stdout, done.stderr + log.read_text()
        os.kill(server, signal.SIGTERM)
        wait_until(lambda: not group.is_running("server"), "its end", 10)
        assert [death.status for death in group.deaths] == [0]


THREADS_ALLOCATE = """
import ctypes, threading
import rospy
from pioneer_node.nodes import entry

rospy.init_node = lambda *_, **__: None
together = threading.Barrier(20)

def allocate():
    kept = bytes(100_000)
    together.wait()

class Node:
    def spin(self):
        threads = [threading.Thread(target=allocate) for _ in range(together.parties)]
        for one in threads: one.start()
        for one in threads: one.join()
        libc = ctypes.CDLL(None)
        libc.malloc_info(0, ctypes.c_void_p.in_dll(libc, "stdout"))
        libc.fflush(None)

raise SystemExit(entry.run("node", Node))
"""


def test_the_threads_of_a_node_share_two_heaps() -> None:
    """Each thread had its own heap, fragmented by large requests: hostile input used to grow the simulator by 25 MB."""
    command = [sys.executable, "-c", THREADS_ALLOCATE]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    assert 1 <= done.stdout.count("<heap nr=") <= 2, done.stdout


COPIES_IMAGES = """
import resource
from pioneer_node.adapters.heap import keep_freed_memory

keep_freed_memory()

def copy_images(count):
    for _ in range(count):
        image = bytes(1000000)
        copies = [image + b"end" for _ in range(3)]

copy_images(3)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
copy_images(50)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def test_memory_of_large_messages_is_kept_for_the_next_ones() -> None:
    """The kernel cleared every page for each image: 250 page faults a copy, over half of the door's CPU time."""
    command = [sys.executable, "-c", COPIES_IMAGES]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    assert int(done.stdout) < 500


READS_A_NAMESPACE = """
import rospy
from pioneer_node.nodes.entry import parameters_below

rospy.init_node("reader", disable_signals=True)
rospy.loginfo("rospy reads a parameter before it logs, and remembers it")
print(sorted(parameters_below("/wheels").items()), parameters_below("/nothing"))
print(parameters_below("/")["wheels"]["left"])
"""


def test_the_parameters_of_a_namespace_are_complete_after_a_node_has_logged() -> None:
    with Master() as master:
        master.set_param("/wheels", {"left": "l", "right": "r"})
        done = subprocess.run(
            [sys.executable, "-c", READS_A_NAMESPACE],
            env=master.environment,
            capture_output=True,
            text=True,
            timeout=START,
            check=True,
        )
    assert done.stdout.splitlines()[-2:] == ["[('left', 'l'), ('right', 'r')] {}", "l"]
