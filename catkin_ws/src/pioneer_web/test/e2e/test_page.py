"""The fleet page in a browser: it shows, drives and stops robots, and reports faults."""

import math
import os
import signal
import time
from pathlib import Path

import pytest
import rosgraph
from page_driver import MOVE, PHONE, SOON, assert_fits_a_phone, confirm, press, send_to
from selenium.webdriver.common.by import By
from served import VIEWER, publish

from pioneer_fleet.recording.recording import messages_of
from pioneer_harness.wait import wait_until

# Selenium leaves a connection to its driver open.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


CAMERA = "/pioneer1/camera/image_raw"


def place(opened, robot="pioneer1"):
    return opened.state(f"{robot}.pose")


def goals(opened, robot="pioneer1"):
    """Returns the x coordinates of a robot's waypoints."""
    return [goal[0] for goal in opened.state(f"{robot}.goals")]


def test_a_click_on_the_map_drives_the_robot_there(driver, opened, shot):
    goal, others = (2.0, 1.5), opened.state("pioneer2.row")["received"]
    wait_until(lambda: driver.execute_script("return fleetPage.view.scale") > 0, "the map", SOON)
    send_to(driver, *goal)
    wait_until(lambda: opened.state("pioneer1.plan"), "its plan", SOON)
    shot("driving")
    wait_until(lambda: math.dist(place(opened)[:2], goal) < 0.4, "the robot at the place", SOON)
    assert opened.state("pioneer2.row")["received"] == others


def test_stop_all_holds_the_robots_until_they_are_released(driver, opened, shot):
    send_to(driver, -4.0, 2.0)
    wait_until(lambda: opened.state("pioneer1.row")["speed"] > 0.5, "the robot under way", SOON)
    press(driver, "stop-all")
    wait_until(lambda: opened.state("pioneer1.row")["speed"] == 0.0, "its stop", SOON)
    before = place(opened)
    shot("stopped")
    send_to(driver, 3.0, 0.0)
    wait_until(
        lambda: "release first" in driver.find_element(By.ID, "answers").text, "the refusal", SOON
    )
    assert math.dist(place(opened)[:2], before[:2]) < 0.05
    assert opened.state("pioneer1.row")["held"]
    press(driver, "release-all")
    confirm(driver)
    wait_until(lambda: not opened.state("pioneer1.row")["held"], "the release", SOON)
    send_to(driver, 0.0, 0.0)
    wait_until(
        lambda: math.dist(place(opened)[:2], (0.0, 0.0)) < 0.4, "the robot that obeys again", SOON
    )


def test_a_waypoint_replaces_those_that_wait_and_append_does_not(driver, opened):
    send_to(driver, 4.0, 2.0)
    # The robot may still have its previous waypoint.
    wait_until(
        lambda: (
            [goal[0] for goal in opened.state("pioneer1.goals")] == [pytest.approx(4.0, abs=0.1)]
        ),
        "one waypoint",
        SOON,
    )
    press(driver, "tool-append")
    driver.execute_script(MOVE, -4.0, -3.0)
    wait_until(lambda: len(goals(opened)) == 2, "two waypoints", SOON)
    send_to(driver, 0.5, 0.5)
    wait_until(lambda: goals(opened) == [pytest.approx(0.5, abs=0.1)], "one", SOON)
    press(driver, "cancel")
    wait_until(lambda: goals(opened) == [], "none", SOON)


def test_a_patrol_repeats_the_waypoints_until_they_are_dropped(driver, opened):
    here = place(opened)
    # Paused, so that the robot reaches no waypoint meanwhile.
    press(driver, "simulate-pause")
    send_to(driver, here[0] + 1.0, here[1])
    wait_until(lambda: len(goals(opened)) == 1, "one waypoint", SOON)
    press(driver, "patrol")
    wait_until(
        lambda: "append some first" in driver.find_element(By.ID, "answers").text,
        "the refusal",
        SOON,
    )
    press(driver, "tool-append")
    driver.execute_script(MOVE, here[0], here[1])
    wait_until(lambda: len(goals(opened)) == 2, "two waypoints", SOON)
    before = opened.state("pioneer1.row")["reached"]
    press(driver, "patrol")
    press(driver, "simulate-resume")
    wait_until(lambda: opened.state("pioneer1.row")["reached"] >= before + 4, "two rounds", SOON)
    assert opened.state("pioneer1.row")["patrols"]
    press(driver, "cancel")
    wait_until(
        lambda: goals(opened) == [] and not opened.state("pioneer1.row")["patrols"], "the end", SOON
    )


def test_a_recording_begins_and_ends_and_can_be_downloaded(driver, opened, fleet):
    press(driver, "record")
    wait_until(lambda: opened.state("recording"), "the recording", SOON)
    path = opened.state("recording")
    wait_until(
        lambda: Path(path).is_file() and Path(path).stat().st_size > 1000,
        "its first messages",
        SOON,
    )
    press(driver, "record")
    link = wait_until(
        lambda: driver.find_elements(By.CSS_SELECTOR, "#answers a"), "the link to the file", SOON
    )
    assert {"/base/pioneer1/odom", "/base/map"} <= {
        message.topic for message in messages_of(Path(path))
    }
    address = link[0].get_attribute("href").removeprefix(fleet.url)
    assert fleet.request(address)[0] == 401
    assert fleet.request(address, fleet.login(VIEWER))[2] == Path(path).read_bytes()
    Path(path).unlink()


def test_camera_images_are_shown_when_asked_for(driver, opened, fleet, shot):
    seen = "return document.querySelector('.camera img')?.naturalWidth > 0"
    press(driver, "cameras")
    wait_until(lambda: driver.execute_script(seen), "an image", SOON)
    shot("camera")
    driver.find_element(By.CSS_SELECTOR, ".camera button").click()
    wait_until(
        lambda: CAMERA not in fleet.master.system_state()[1], "the end of the subscription", SOON
    )


def test_a_lost_gateway_is_red_with_its_reason(driver, opened, fleet, shot):
    publish(fleet, "/stand_in/lose", "std_msgs/String", "aadi2_gateway")
    began = time.monotonic()
    wait_until(
        lambda: "no such gateway" in driver.find_element(By.ID, "robots").text, "its reason", SOON
    )
    row = driver.find_element(By.CSS_SELECTOR, '[data-robot="pioneer2"] .bad')
    assert "aadi2_gateway is not on the hub" in row.text
    shot("lost")
    publish(fleet, "/stand_in/lose", "std_msgs/String", "nobody")
    wait_until(lambda: not opened.state("pioneer2.row")["fault"], "its return", SOON)
    assert time.monotonic() - began < SOON


def test_why_a_robot_does_not_get_on_is_shown_in_its_own_words(driver, opened, fleet):
    topic, kind = "/pioneer2/move_base/state", "nav_bundle/NavigationState"
    reason = "blocked: the way is blocked near (7.2, 6.8) by something that the map does not show"
    publish(fleet, topic, kind, f"{{state: 4, text: '{reason}'}}")
    wait_until(lambda: opened.state("pioneer2.row")["trouble"] == reason, "its reason", SOON)
    row = driver.find_element(By.CSS_SELECTOR, '[data-robot="pioneer2"] .bad')
    assert row.text == reason
    wait_until(
        lambda: [one["what"] for one in opened.state("alerts") if not one["until"]] == [reason],
        "its alert",
        SOON,
    )
    publish(fleet, topic, kind, "{state: 2, text: driving}")
    wait_until(lambda: not opened.state("pioneer2.row")["trouble"], "that it drives", SOON)


def answer(driver, words):
    return wait_until(
        lambda: words in driver.find_element(By.ID, "answers").text, f"the answer '{words}'", SOON
    )


def test_a_waypoint_in_a_wall_or_outside_the_map_is_refused_at_the_click(driver, opened):
    received = opened.state("pioneer1.row")["received"]
    for place, reason in (((6.0, 0.0), "a wall of the map"), ((200.0, 0.0), "outside the map")):
        send_to(driver, *place)
        answer(driver, reason)
    send_to(driver, 7.5, 0.0)
    answer(driver, "no way leads there")
    assert opened.state("pioneer1.row")["received"] == received


def test_a_reset_asks_first_and_localises_the_robots_where_they_started(driver, opened, fleet):
    press(driver, "simulate-reset")
    driver.find_element(By.CSS_SELECTOR, "dialog[open] button").click()  # Cancel
    press(driver, "simulate-reset")
    confirm(driver)
    answer(driver, "robots localised where they started")

    def localised():
        try:
            return fleet.master.get_param("/stand_in/pioneer1/localised")
        except rosgraph.MasterError:
            return None

    wait_until(lambda: localised() == [-4.0, -2.0], "the initial pose", SOON)


def test_a_step_that_the_simulator_refuses_is_answered_with_its_reason(driver, opened):
    press(driver, "simulate-step")
    answer(driver, "simulator: not paused")


def test_a_lost_connection_is_said_and_what_is_shown_ages(driver, opened, fleet, shot):
    wait_until(lambda: opened.state("pioneer1.row")["odom"] is not None, "an age", SOON)
    os.kill(fleet.pid, signal.SIGSTOP)
    try:
        banner = driver.find_element(By.ID, "banner")
        wait_until(lambda: "No connection" in banner.text, "the banner", SOON)
        stop = driver.find_element(By.CSS_SELECTOR, '[data-act="stop-all"]')
        assert not stop.is_enabled()
        age = "return document.querySelector('[data-robot=pioneer1] td:nth-child(6)').textContent"
        wait_until(lambda: float(driver.execute_script(age).split()[0]) > 2.0, "an age", SOON)
        shot("disconnected")
    finally:
        os.kill(fleet.pid, signal.SIGCONT)
    wait_until(lambda: not banner.is_displayed(), "the connection", SOON)
    assert stop.is_enabled()


def test_a_reload_changes_nothing(driver, opened):
    press(driver, "cancel")
    wait_until(lambda: not opened.state("pioneer1.row")["moving"], "the robot's rest", SOON)
    before = place(opened)
    driver.refresh()
    wait_until(lambda: place(opened), "the pose after a reload", SOON)
    assert place(opened)[:2] == pytest.approx(before[:2], abs=0.1)


def test_load_and_log_of_a_robots_computer_are_shown(driver, opened):
    assert opened.state("pioneer1.row")["load"] == [0.31, 180]
    assert "180 MiB" in driver.find_element(By.CSS_SELECTOR, '[data-robot="pioneer1"]').text


def test_a_phone_shows_map_table_and_stop(driver, opened, shot):
    try:
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", PHONE)
        driver.refresh()
        wait_until(lambda: place(opened), "the pose", SOON)
        send_to(driver, 1.0, 2.0)
        wait_until(lambda: opened.state("pioneer1.plan"), "a plan", SOON)
        assert_fits_a_phone(driver)
        shot("phone")
        for name in ("alerts", "network", "log", "robots"):
            driver.find_element(By.ID, f"tab-{name}").click()
            assert driver.find_element(By.ID, f"panel-{name}").is_displayed()
            assert_fits_a_phone(driver)
            shot(f"phone-{name}")
    finally:
        driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_logging_out_ends_the_session(driver, opened):
    press(driver, "logout")
    wait_until(lambda: driver.find_elements(By.ID, "token"), "the login page", SOON)
    driver.refresh()
    assert driver.find_elements(By.ID, "token")
