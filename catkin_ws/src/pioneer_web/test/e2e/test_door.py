"""What does not cross the door to ROS 2 is on the fleet page, in a browser, and in doctor."""

import os
import subprocess
from pathlib import Path

import pytest
from page_driver import SOON
from selenium.webdriver.common.by import By

from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

pytest.importorskip("cyclonedds", reason="the door to ROS 2 is not installed")

ROOT = Path(__file__).resolve().parents[5]
PEER = ROOT / ".setup" / "ros2-peer" / "bin" / "python3"
ODD_PEER = ROOT / "catkin_ws" / "src" / "pioneer_ros2" / "test" / "e2e" / "odd_peer.py"
READ = "ROS 2 reads it as std_msgs/String, but it is nav_msgs/Odometry"
WRITTEN = "ROS 2 sends std_msgs/String, which does not become geometry_msgs/Twist"
LIMIT = 60.0

pytestmark = [
    # Selenium leaves a connection to its driver open.
    pytest.mark.filterwarnings(
        "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
    ),
    pytest.mark.skipif(
        not PEER.exists(), reason="no ROS 2 for the tests (PyPI has it for Python 3.11)"
    ),
]


def door_rows(driver):
    """Returns the texts of the door's rows in the panel of the network."""
    # In one call: the page replaces the rows several times a second.
    script = "return [...document.querySelectorAll('#panel-network tr')].map(row => row.innerText)"
    return [text for text in driver.execute_script(script) if "ROS 2" in text]


def test_what_does_not_cross_the_door_is_on_the_page_and_in_doctor_with_its_reason(
    driver, opened, fleet, shot, tmp_path
):
    domain = str(40 + os.getpid() % 20)  # no other file of tests uses these
    environment = {**os.environ, **fleet.master.environment, "ROS_DOMAIN_ID": domain}
    alone = {name: value for name, value in environment.items() if name != "PYTHONPATH"}
    driver.find_element(By.ID, "tab-network").click()
    assert door_rows(driver) == []
    with ProcessGroup() as group:
        door = ["rosrun", "pioneer_ros2", "ros2_door"]
        group.start("door", door, environment, tmp_path / "door.log")
        odd = [str(PEER), str(ODD_PEER), "types"]
        group.start("odd peer", odd, alone, tmp_path / "odd.log")
        for topic, reason in (("/pioneer1/odom", READ), ("/pioneer1/cmd_vel", WRITTEN)):
            wait_until(
                lambda topic=topic, reason=reason: [
                    row for row in door_rows(driver) if topic in row and reason in row
                ],
                f"{topic} with its reason on the page",
                SOON,
            )
        shot("door")
        doctor = subprocess.run(
            ["rosrun", "rocon_gateway", "doctor"],
            env=environment,
            capture_output=True,
            text=True,
            timeout=LIMIT,
            check=False,
        )
        assert "the door to ROS 2, /ros2_door: " in doctor.stdout, doctor.stdout + doctor.stderr
        for reason in (READ, WRITTEN):
            assert reason in doctor.stdout, doctor.stdout
        group.kill("odd peer")
        wait_until(lambda: door_rows(driver) == [], "a page without faults of the door", SOON)
