"""The commands ``ESTOP`` and ``cancel_waypoint``."""

import argparse
import threading

import rosgraph
import rospy

from pioneer_control.nodes.fleet import Fleet

_TIMEOUT = 5.0
_ZERO_EVERY = 0.05
_SCAN_EVERY = 1.0  # all in s of wall time


def _begin(name: str, description: str, once: bool) -> argparse.Namespace:
    """Parses the command line and starts the node; exits if no master is running."""
    parser = argparse.ArgumentParser(prog=name, description=description)
    parser.add_argument(
        "robots",
        nargs="*",
        metavar="ROBOT",
        help="namespace, as pioneer1; all robots where none is given",
    )
    if once:
        parser.add_argument("--once", action="store_true", help="stop and cancel now, then end")
    options = parser.parse_args(rospy.myargv()[1:])
    if not rosgraph.is_master_online():
        rospy.logfatal("no ROS master at %s", rosgraph.get_master_uri())
        raise SystemExit(1)
    rospy.init_node(name.lower(), anonymous=True)
    return options


def _report(fleet: Fleet) -> int:
    """Waits until the goals have ended, logs it, and returns the exit status."""
    unended = fleet.wait_until_cancelled(_TIMEOUT)
    for action in unended:
        rospy.logerr(
            "%s has not confirmed within %.0f s that its goals are cancelled", action, _TIMEOUT
        )
    count = len(fleet.targets.actions) - len(unended)
    rospy.loginfo(
        "goals cancelled at %d move_base; waypoint queues cleared: %d",
        count,
        len(fleet.targets.clears),
    )
    return 1 if unended else 0


def cancel_waypoint() -> int:
    """Runs ``cancel_waypoint [ROBOT...]``: clears waypoint queues and cancels goals; returns the exit status."""
    options = _begin(
        "cancel_waypoint",
        "Clear the waypoints of robots and cancel the goals they drive to.",
        once=False,
    )
    fleet = Fleet(options.robots)
    if not fleet.discover().actions:
        rospy.logwarn(
            "no move_base here%s", f" of {', '.join(options.robots)}" if options.robots else ""
        )
        return 1
    fleet.cancel()
    return _report(fleet)


def estop() -> int:
    """Runs ``ESTOP [--once] [ROBOT...]``: holds robots still until Ctrl-C; returns the exit status."""
    options = _begin(
        "ESTOP", "Stop robots and cancel their goals, and hold them so until Ctrl-C.", once=True
    )
    fleet = Fleet(options.robots, hold=True)
    if not fleet.discover().commands:
        rospy.logwarn(
            "no robot here%s", f" called {', '.join(options.robots)}" if options.robots else ""
        )
        if options.once:
            return 1
    ended = threading.Event()
    rospy.on_shutdown(ended.set)
    zeros = threading.Thread(target=_hold_still, args=(fleet, ended), daemon=True)
    zeros.start()
    fleet.cancel()
    if options.once:
        return _report(fleet)
    rospy.logwarn("robots held still: %d; Ctrl-C releases them", len(fleet.targets.commands))
    while not ended.wait(_SCAN_EVERY):
        fleet.discover()
        fleet.cancel()
    return 0


def _hold_still(fleet: Fleet, ended: threading.Event) -> None:
    while not ended.wait(_ZERO_EVERY):
        fleet.stop()
