"""``./pioneer up``: starts a fleet, or its missing parts, and waits for what it has started."""

import contextlib
import json
import os
import sys
import time
import urllib.parse
from argparse import Namespace
from collections.abc import Sequence
from typing import Any

from containers import image
from containers.deployment import Deployment, is_on_swarm
from containers.engine import DESKTOP, PAGES, ROS2, WEB, Computer, ContainerError, output, say
from containers.fleet_plan import DOWN, FleetPlan, is_idle, make_fleet_plan
from containers.layout import SUBNET, compose_text
from containers.report import follow, progress_line
from containers.state import (
    BASE,
    SHIPPED,
    project,
    secret,
    subnet,
    write_whole,
    written_compose,
    written_subnet,
)
from pioneer_harness.proc import processors

JOINED = "/var/lib/pioneer/robots"
"""File on the base station with the number of robots, once more have joined (docker/computer)."""
START_UP, START_UP_PER_ROBOT = 120.0, 10.0
COMPUTERS_A_PROCESSOR = 3
"""Number of computers that may start at once, per processor. Each starts a dozen programs, which takes about ten
seconds of processor time, and roslaunch gives its master only ten seconds to answer."""
_UP = ("bash", "-c", "until /opt/pioneer/docker/healthy 2>/dev/null; do sleep 0.5; done")
_PAGE = "until (exec 3<>/dev/tcp/$HOSTNAME/{port}) 2>/dev/null; do sleep 0.5; done"
_DOOR = "until rosnode list 2>/dev/null | grep -qx /ros2_door; do sleep 0.5; done"


def up(options: Namespace) -> int:
    """Runs the command; returns its exit status.

    Raises:
        ContainerError: the request is impossible or failed; the text says why.
    """
    began = time.monotonic()
    # Report an engine that does not answer and impossible options before anything is built or written.
    swarm = Deployment(options) if is_on_swarm(options) else None
    there = swarm.stack.computers() if swarm else _computers(options.project)
    plan = make_fleet_plan(options, there, swarm.processors if swarm else processors())
    if not swarm and plan.base:
        _check_subnet(options.project)
    if plan.remark:
        say(plan.remark)
    if plan.base and not swarm and image.is_outdated():
        say(f"the sources have changed: this fleet keeps its image; for a new one {DOWN}")
    image.ensure_images(options.extras, fleet=options.update or not plan.base)
    if swarm:
        name = swarm.image(plan)
        built = time.monotonic()
        computers = swarm.start(plan, name)
    else:
        text = compose_text(SHIPPED.read_text(), plan.robots, subnet(options.project))
        write_whole(written_compose(options.project), text)
        built = time.monotonic()
        computers = _start(plan, options)
    for extra in options.extras:
        # The fleet page and the door to ROS 2 have to wait for the world.
        if extra == DESKTOP or (plan.base and not is_idle(plan.base)):
            _await_extra(next(one for one in computers if one.name == BASE), extra)
        say(_address(extra, subnet(options.project)))
    if plan.base:
        joiners = plan.joiners(computers)
        with_ros2 = bool(joiners) and not swarm and project(options.project).runs(ROS2)
        _join(plan.base, joiners, with_ros2)
    if plan.idle:
        _say_idle(plan, computers)
        return 0
    if options.extras and not plan.started:
        return 0
    return _await(plan, computers, options.waypoints, built - began, built)


def _computers(name: str) -> list[Computer]:
    """Returns the fleet's computers, once no Compose of a killed call adds any."""
    fleet = project(name)
    with fleet.alone():
        return fleet.computers()


def _check_subnet(name: str) -> None:
    """Refuses to move a running fleet into another subnet."""
    running = written_subnet(name)
    given = os.environ.get(SUBNET)
    if given and running and given != running:
        raise ContainerError(f"{SUBNET} is {given}, and a fleet runs in {running}: {DOWN}")


def _start(plan: FleetPlan, options: Namespace) -> list[Computer]:
    """Starts the containers that do not run yet; returns all of the fleet's."""
    extras = {"COMPOSE_PROFILES": ",".join(options.extras)} if options.extras else {}
    fleet = project(options.project, **plan.variables, **extras)
    new, size = plan.started, max(1, int(COMPUTERS_A_PROCESSOR * processors()))
    # Leave running containers alone, so that more robots can join.
    keep = ["--no-recreate"] if plan.base else []
    for begin in range(0, len(new) - size, size):
        wave = new[begin : begin + size]
        fleet.run("up", "-d", *keep, *wave)
        say(f"waiting for {wave[0]} … {wave[-1]} to start, then for {len(new) - begin - size} more")
        _await_gateways([one for one in fleet.computers() if one.name in wave])
    fleet.run("up", "-d", *keep)
    return fleet.computers()


def _await_gateways(computers: Sequence[Computer]) -> None:
    """Waits until the computers' gateways accept connections: by then their masters answer."""
    for one in computers:
        # A computer that has ended or is late is asked at the end what it lacks.
        with contextlib.suppress(ContainerError):
            output("docker", "exec", one.container, "timeout", f"{START_UP:g}", *_UP)


def _await_extra(base: Computer, extra: str) -> None:
    """Waits until an extra's page is served on the base station's network, or its node is on the master."""
    wait = ("bash", "-c", _DOOR if extra == ROS2 else _PAGE.format(port=PAGES[extra]))
    try:
        output("docker", "exec", base.container, "timeout", f"{START_UP:g}", *wait)
    except ContainerError:
        raise ContainerError(
            f"service {extra} does not answer after {START_UP:g} s; ./pioneer logs {extra}"
        ) from None


def _address(extra: str, network: str) -> str:
    """Returns the line that says where an extra is: with its page's address, or with the domain in ROS 2."""
    if extra == ROS2:
        domain = os.environ.get("ROS_DOMAIN_ID") or "0"
        return f"Door to ROS 2: domain {domain}, for nodes on this machine and in {network}.0/24 (docs/ros2.md)"
    word = secret(f"{extra}-token").read_text().strip()
    page = f"http://{network}.100:{PAGES[extra]}"
    if extra == WEB:
        return f"Fleet page, once it is up: {page}/#{word}"
    query = {"autoconnect": "true", "resize": "scale", "path": f"websockify?token={word}"}
    return f"desktop with RViz: {page}/vnc.html?{urllib.parse.urlencode(query)}"


def _join(base: Computer, robots: Sequence[str], with_ros2: bool) -> None:
    """Adds robots to the running world and later ones, and what RViz and ROS 2 get of them to the base station.

    The world already has robots that joined earlier, unless it was restarted on another machine.
    """
    if not robots:
        return
    count = robots[-1].removeprefix("pioneer")
    on_base = (*base.docker, "exec")
    joined = output(*on_base, base.container, "sh", "-c", f"cat {JOINED} 2>/dev/null; true").strip()
    robots = robots[int(joined) - int(base.environment["ROBOTS"]) :] if joined else robots
    if not robots:
        return
    names = [f"pioneer{number}" for number in range(1, int(count) + 1)]
    output(*on_base, base.container, "rosparam", "set", "/robot_names", json.dumps(names))
    for script in ("flip-from-hub", *(("flip-for-ros2",) if with_ros2 else ())):
        output(*on_base, base.container, "rosrun", "rocon_flip", script, count)
    for robot in robots:
        pose = " ".join(
            f"-{option} $(rosparam get /{robot}/{key})"
            for option, key in zip("xyY", "xya", strict=True)
        )
        launch = f'exec roslaunch pioneer_description generic_pioneer.launch name:={robot} pose:="{pose}"'
        output(*on_base, "-d", base.container, "bash", "-c", f"{launch} >/proc/1/fd/1 2>&1")
        # Only now: if this call is interrupted, the next one adds the robots that are not counted.
        output(
            *on_base, base.container, "sh", "-c", f"echo {robot.removeprefix('pioneer')} >{JOINED}"
        )


def _say_idle(plan: FleetPlan, computers: Sequence[Computer]) -> None:
    idle = [one.name for one in computers if is_idle(one)]
    shells = ", ".join(f"./pioneer exec {name}" for name in idle[:2])
    say(f"{len(idle)} computer{'s are' if len(idle) > 1 else ' is'} up and idle: {shells}, …")
    if plan.base and is_idle(plan.base) and int(plan.base.environment["ROBOTS"]) < plan.robots:
        say(f"step 3 on {BASE} now wants robots:={plan.robots}")


def _await(
    plan: FleetPlan,
    computers: Sequence[Computer],
    waypoints: int,
    image_seconds: float,
    started: float,
) -> int:
    """Waits until the started computers' robots have driven; the others, which get no waypoints, need only be ready."""
    latest: dict[str, dict[str, Any]] = {}
    sent = plan.started if waypoints else []
    until = {
        one.name: "moving" if one.name in sent else "ready" for one in computers if not is_idle(one)
    }
    timeout = START_UP + START_UP_PER_ROBOT * plan.robots

    def words(computer: Computer) -> list[str]:
        count = waypoints if until[computer.name] == "moving" else 0
        limits = ["--until", until[computer.name], "--timeout", f"{timeout:g}"]
        return [*limits, "--waypoints", str(count), "--robots", str(plan.robots)]

    def heard(computer: Computer, line: dict[str, Any]) -> None:
        latest[computer.name] = line
        say(f"{time.monotonic() - started:5.1f} s  {progress_line(computer.name, line)}")

    came = follow([(one, words(one)) for one in computers if one.name in until], heard)
    seconds = time.monotonic() - started
    late = sorted(name for name, well in came.items() if not well)
    for name in late:
        print(f"{name}: {latest.get(name, {}).get('lacks') or 'does not move'}", file=sys.stderr)
    if late:
        which = ", ".join(f"{name} not {until[name]}" for name in late)
        raise ContainerError(f"{which} after {seconds:.0f} s; ./pioneer logs {late[0]} has more")
    built = f", after {image_seconds:.0f} s for the image" if image_seconds > 5 else ""
    say(f"{_who(plan, computers, waypoints)} after {seconds:.0f} s{built}")
    return 0


def _who(plan: FleetPlan, computers: Sequence[Computer], waypoints: int) -> str:
    """Returns the beginning of the sentence: which robots do what."""
    robots = [one for one in computers if one.robot and not is_idle(one)]
    new = [one for one in robots if plan.starts(one.name)]
    if not new:
        return f"{len(robots)} robots, which ran already and are sent nowhere, are ready"
    one, more = len(new) == 1, " more" if plan.base else ""
    do = ("drives" if one else "drive") if waypoints else ("is ready" if one else "are ready")
    return f"{len(new)}{more} robot{'' if one else 's'} {do}"
