"""The page of a real fleet of two robots: display, driving, stop, faults, phone layout, and Foxglove's protocol."""

import math
import os
import signal
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import rospy
from foxglove_client import WAIT, advertise, foxglove_client, publish
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry
from page_driver import PHONE, SOON, assert_fits_a_phone, confirm, known, press, send_to, shown
from selenium.webdriver.common.by import By
from sensor_msgs.msg import LaserScan
from served import TOKEN, request, wait_for_page
from tf2_msgs.msg import TFMessage
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from pioneer_demo.console.stopwatch import Stopwatch
from pioneer_demo.processes.command import gateway_name
from pioneer_demo.processes.processes import FleetProcesses
from pioneer_demo.run.fleet_run import FleetRun
from pioneer_demo.scenario.option import FleetConfig
from pioneer_harness.wait import wait_until

pytestmark = [
    pytest.mark.alone,
    # Selenium leaves a connection to its driver open; rospy uses a deprecated name from threading.
    pytest.mark.filterwarnings(
        "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
    ),
    pytest.mark.filterwarnings("ignore:notifyAll:DeprecationWarning"),
]
NAMES = ["pioneer1", "pioneer2"]
SHOWN, STOPPED, RED = 3.0, 0.2, 3.0
"""Time limits for the page to show the robots, to stop one, and to show a fault [s]."""
LOG = "return Object.keys(fleetPage.state).filter(key => key.startsWith('log.')).map(key => fleetPage.state[key])"
STOP = "const at = Date.now(); document.querySelector('[data-act=\"stop-all\"]').click(); return at / 1000;"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Yields a fleet of two robots in small_world that accept waypoints."""
    config = FleetConfig(
        world="small_world",
        real_time_factor=0.5,
        log=tmp_path_factory.mktemp("fleet"),
        web=True,
        token=TOKEN,
    )
    interrupt = SimpleNamespace(check=lambda: None, is_set=lambda: False)
    with FleetProcesses(config) as processes:
        processes.start()
        fleet = FleetRun(config, Stopwatch(), interrupt, processes)
        try:
            fleet.start()
            yield fleet
        finally:
            fleet.stop(in_order=False)


@pytest.fixture(scope="module")
def url(run):
    """Returns the page's address once it is served. The fleet does not wait for its page; robots may drive before."""
    address = f"http://127.0.0.1:{run.processes.ports.page}"
    wait_for_page(address)
    return address


@pytest.fixture(scope="module")
def page(url, driver):
    """Opens the page with the operator's token; returns how long it took to show both robots."""
    began = time.monotonic()
    driver.get(f"{url}/#{TOKEN}")
    wait_until(lambda: shown(driver) == NAMES, "both robots on the map", SOON)
    wait_until(lambda: len(rows(driver)) == len(NAMES), "both robots in the table", SOON)
    return SimpleNamespace(took=time.monotonic() - began)


@pytest.fixture
def heard(run):
    """Yields lists of the messages received at the simulator's master, each with its time of arrival."""
    messages = {"odom": [], "pioneer/cmd_vel": []}
    subscribers = [
        rospy.Subscriber(
            f"/pioneer1/{topic}",
            kind,
            lambda one, kept=messages[topic]: kept.append((time.time(), one)),
        )
        for topic, kind in (("odom", Odometry), ("pioneer/cmd_vel", Twist))
    ]
    yield messages
    for one in subscribers:
        one.unregister()


def rows(driver):
    return driver.find_elements(By.CSS_SELECTOR, "#robots [data-robot]")


def place(driver, robot="pioneer1"):
    return known(driver, f"{robot}.pose")[:2]


def test_an_unauthenticated_client_gets_401_and_no_data(url, driver):
    for path in ("/", "/map.png", "/metrics", "/static/main.js"):
        status, _, body = request(url, path)
        assert status == 401
        assert b"pioneer1" not in body
    for path in ("/live", "/foxglove"):
        with pytest.raises(InvalidStatus), connect(url.replace("http", "ws") + path):
            pass
    driver.get(url)
    assert driver.find_element(By.ID, "token").is_displayed()
    assert "pioneer1" not in driver.page_source


def test_a_killed_page_is_started_again_and_the_fleet_keeps_running(url, run):
    (pid,) = (
        member.popen.pid
        for member in run.processes.group._members.values()
        if member.name == "fleet page"
    )
    os.kill(pid, signal.SIGKILL)
    wait_until(lambda: not Path(f"/proc/{pid}").exists(), "its end", SOON)
    run.look(None, "up")
    wait_for_page(url, lambda: run.look(None, "up"))


def test_both_robots_are_shown_soon_after_opening(page, record_property):
    record_property("shown after [s]", page.took)
    assert page.took <= SHOWN


def test_a_click_on_the_map_drives_the_robot_there(driver, page, run, shot):
    goal = (-4.5, 2.0)
    send_to(driver, *goal)
    wait_until(
        lambda: known(driver, "pioneer1.plan") and known(driver, "pioneer1.goals"),
        "goal and plan",
        SOON,
    )
    wait_until(lambda: known(driver, "pioneer1.row")["speed"] > 0.1, "the robot under way", SOON)
    shot("real-driving")
    wait_until(lambda: known(driver, "pioneer1.row")["reached"] == 1, "the waypoint reached", SOON)
    truth = run.fleet.robots[0].pose
    assert math.dist((truth.x, truth.y), goal) < 0.4
    assert math.dist(place(driver), (truth.x, truth.y)) < 0.4


def test_load_and_logs_of_the_robots_computers_are_shown(driver, page):
    loads = [lambda name=name: known(driver, f"{name}.row")["load"] for name in NAMES]
    wait_until(lambda: all(one() for one in loads), "the load of both computers", SOON)
    assert all(0.0 < one()[0] < 2.0 and 30 < one()[1] < 2000 for one in loads)
    send_to(driver, -4.5, 1.0)
    wait_until(
        lambda: any(line[3] == "aadi1" for line in driver.execute_script(LOG)),
        "a line of aadi1",
        SOON,
    )


def test_a_stop_reaches_the_simulator_at_once_and_holds(driver, page, heard, shot, record_property):
    send_to(driver, -4.5, -3.0)
    odom = heard["odom"]
    wait_until(lambda: odom and odom[-1][1].twist.twist.linear.x > 0.3, "the robot under way", SOON)
    pressed = driver.execute_script(STOP)
    wait_until(lambda: abs(odom[-1][1].twist.twist.linear.x) < 0.02, "its stop", SOON)
    zero = next(at for at, one in heard["pioneer/cmd_vel"] if at > pressed and one == Twist())
    stood = next(at for at, one in odom if at > pressed and abs(one.twist.twist.linear.x) < 0.02)
    record_property("zero at the simulator after [s]", zero - pressed)
    record_property("robot stands after [s]", stood - pressed)
    assert zero - pressed <= STOPPED
    wait_until(lambda: known(driver, "pioneer1.row")["held"], "'held' on the page", SOON)
    before, count = odom[-1][1].pose.pose.position, len(odom)
    shot("real-stopped")
    wait_until(lambda: len(odom) > count + 100, "another second of odometry", SOON)
    after = odom[-1][1].pose.pose.position
    assert math.dist((before.x, before.y), (after.x, after.y)) < 0.05
    press(driver, "release-all")
    confirm(driver)
    wait_until(lambda: not known(driver, "pioneer1.row")["held"], "the release", SOON)


def test_a_client_of_foxglove_reads_tf_and_a_scan_and_sends_a_goal(url, run):
    with foxglove_client(url, TOKEN) as client:
        client.await_topic("/tf", "/pioneer2/base_scan")
        tf, scan = client.messages(tf="/tf", scan="/pioneer2/base_scan")
        assert TFMessage().deserialize(tf).transforms
        scan = LaserScan().deserialize(scan)
        assert any(scan.range_min < value < scan.range_max for value in scan.ranges)
        advertise(client, 1, "/pioneer2/map_goal_pose", "geometry_msgs/PoseStamped")
        goal = PoseStamped()
        goal.header.frame_id, goal.pose.orientation.z = "map", 1.0
        goal.pose.position.x, goal.pose.position.y = 3.2, 3.5
        publish(client, 1, goal)
        wait_until(
            lambda: run.fleet.robots[1].queue.received == 1, "the goal at the robot's client", WAIT
        )


def test_a_reload_changes_nothing(driver, page):
    before = place(driver)
    name = "return document.querySelector('#robots [data-robot] td').textContent"
    text = driver.execute_script(name)
    driver.refresh()
    wait_until(lambda: shown(driver) == NAMES and rows(driver), "both robots after a reload", SOON)
    assert place(driver) == pytest.approx(before, abs=0.1)
    assert driver.execute_script(name) == text
    assert known(driver, "pioneer1.row")["reached"] >= 1


def test_a_phone_shows_it_legibly(driver, page, shot):
    try:
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", PHONE)
        driver.refresh()
        wait_until(lambda: shown(driver) == NAMES and rows(driver), "both robots", SOON)
        send_to(driver, -4.5, 0.5)
        wait_until(lambda: known(driver, "pioneer1.plan"), "a plan", SOON)
        assert_fits_a_phone(driver)
        shot("real-phone")
    finally:
        driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_killed_gateway_is_red_with_its_reason_soon(driver, page, run, shot, record_property):
    wait_until(lambda: not red(driver, "pioneer2"), "pioneer2 without a fault", SOON)
    began = time.monotonic()
    run.processes.kill([gateway_name(2)])
    wait_until(lambda: "aadi2_gateway" in red(driver, "pioneer2"), "pioneer2 red, and why", SOON)
    took = time.monotonic() - began
    record_property("red after [s]", took)
    assert took <= RED
    assert "aadi1_gateway" not in red(driver, "pioneer1")
    press(driver, "fit")
    shot("real-lost")


def red(driver, robot):
    script = 'return document.querySelector(`#robots [data-robot="${arguments[0]}"] .bad`)?.textContent ?? ""'
    return driver.execute_script(script, robot)
