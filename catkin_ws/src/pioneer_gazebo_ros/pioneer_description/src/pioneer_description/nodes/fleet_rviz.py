"""``fleet_rviz``: opens RViz on the fleet's robots, in its own window (uses Debian's Python bindings of RViz)."""
# ruff: noqa: T201 - a command prints to standard output

import argparse
import contextlib
import ctypes
import ctypes.util
import math
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import rospy
import yaml

from pioneer_description.adapters.hidden_rviz import running
from pioneer_description.core.fleet_view import Bounds, fitted_scale, fleet_config, tool_name
from pioneer_description.core.scene import SceneError
from pioneer_description.nodes.fleet_watch import FleetWatch
from pioneer_description.nodes.rviz_snapshot import TEMPLATE, names_of, read_config

_POLL = 100
"""Interval at which the window checks for shutdown [ms]."""
_NO_SIGINT_HANDLER = 1
"""A flag of ``ros::init_options``."""


class _String(ctypes.Structure):
    """The memory layout of a ``std::string`` of libstdc++, for read-only use."""

    _fields_ = (("data", ctypes.c_char_p), ("size", ctypes.c_size_t), ("room", ctypes.c_char * 16))


def _roscpp_node(name: bytes) -> Callable[[], bool]:
    """Starts the C++ node of RViz, whose bindings cannot set its name; without one it calls itself ``/rviz_…``.

    Args:
        name: default name if the command line has no ``__name:=``; rules refer to the node by name.

    Returns:
        A function that returns False once shutdown was requested.
    """
    # The library loaded by the bindings. Its functions have C++ mangled names:
    # init(int&, char**, const std::string&, uint32_t) and ok().
    library = ctypes.CDLL(ctypes.util.find_library("roscpp"))
    words = [os.fsencode(word) for word in sys.argv]
    init = library._ZN3ros4initERiPPcRKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEEj
    init.restype = None
    init(
        ctypes.byref(ctypes.c_int(len(words))), (ctypes.c_char_p * (len(words) + 1))(*words),
        ctypes.byref(_String(name, len(name))), ctypes.c_uint32(_NO_SIGINT_HANDLER),
    )  # fmt: skip
    is_up = library._ZN3ros2okEv
    is_up.restype = ctypes.c_bool
    return is_up


class FleetRviz:
    """The RViz window of a fleet; its node is ``/rviz``."""

    def __init__(self, title: str) -> None:
        from python_qt_binding.QtCore import QTimer
        from python_qt_binding.QtWidgets import QApplication
        from rviz import bindings

        self._bindings = bindings
        self._application = QApplication(["rviz"])
        self._is_up = _roscpp_node(b"rviz")
        self._frame = bindings.VisualizationFrame()
        self._frame.setSplashPath("")
        with _without(b"media_export", b"[librospack]: error while executing command"):
            self._frame.initialize()
        self._frame.setWindowTitle(f"{title}[*]")
        # RViz has replaced the signal handlers; the timer gives Python a chance to run its own.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self._application.quit())
        self._timer = QTimer()
        self._timer.timeout.connect(self._look)
        self._timer.start(_POLL)

    def show(self, config: Mapping[str, Any]) -> None:
        """Loads a configuration and names each robot's tools after it."""
        with tempfile.NamedTemporaryFile("w", suffix=".rviz") as file:
            yaml.safe_dump(dict(config), file, allow_unicode=True)
            file.flush()
            reader, read = self._bindings.YamlConfigReader(), self._bindings.Config()
            reader.readFile(read, file.name)
            self._frame.load(read)
        tools = self._frame.getManager().getToolManager()
        for index, tool in enumerate(config["Visualization Manager"]["Tools"]):
            if name := tool_name(tool):
                tools.getTool(index).setName(name)
        # Without a window manager nothing else maximises the window.
        self._frame.setGeometry(self._application.primaryScreen().availableGeometry())
        self._frame.showMaximized()

    def fit(self, bounds: Bounds) -> float:
        """Fits the view to a rectangle of the map and returns its scale [pixels/m]."""
        self._application.processEvents()
        scene = self._frame.centralWidget()
        scale = fitted_scale(bounds, (scene.width(), scene.height()))
        self._frame.getManager().getViewManager().getCurrent().subProp("Scale").setValue(scale)
        return scale

    def run(self) -> int:
        """Runs until the window is closed or shutdown is requested; returns RViz's exit status."""
        return int(self._application.exec_())

    def _look(self) -> None:
        if rospy.is_shutdown() or not self._is_up():
            self._application.quit()


@contextlib.contextmanager
def _without(*noise: bytes) -> Iterator[None]:
    """Filters lines that contain ``noise`` from standard error during the block: RViz looks for a package of icons that
    Debian does not have.
    """
    sys.stderr.flush()
    error = os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(error, 2)
            os.close(error)
            file.seek(0)
            for line in file:
                if not any(one in line for one in noise):
                    os.write(2, line)


def main(argv: Sequence[str] | None = None) -> int:
    """Waits for the fleet, shows it, and returns the exit status."""
    options = _options(rospy.myargv(sys.argv)[1:] if argv is None else argv)
    # The node name on the command line is meant for RViz.
    rospy.init_node("fleet_rviz", anonymous=True, argv=[])
    watch = FleetWatch()
    try:
        template = read_config(options.config)
        wanted = names_of(options.robots)
        if watch.wait(wanted, math.inf, lambda text: print(f"fleet_rviz: {text}", flush=True)):
            return 130
        robots, bounds = watch.robots(wanted), watch.bounds
        window = FleetRviz(f"{', '.join(robot.name for robot in robots)} - RViz")
        window.show(fleet_config(template, robots, bounds, (1500, 1000)))
        watch.name_robots(robots, window.fit(bounds))
        flips = ["rosrun", "rocon_flip", "flip-tools-from-hub", *(robot.name for robot in robots)]
        with running(flips) if options.tools == "true" else contextlib.nullcontext():
            return window.run()
    except (SceneError, OSError) as error:
        print(f"fleet_rviz: {error}", file=sys.stderr)
        return 1
    finally:
        rospy.signal_shutdown("done")


def _options(words: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        "fleet_rviz", description="Opens RViz on the robots of this master."
    )
    parser.add_argument(
        "--config",
        type=Path,
        default=TEMPLATE,
        help="RViz configuration whose groups are the robots'",
    )
    parser.add_argument("--robots", default="", metavar="N|NAMES",
        help="wait for pioneer1 … N, or these space-separated names (default: the fleet's)")  # fmt: skip
    parser.add_argument("--tools", choices=["true", "false"], default="true",
        help="whether goals and poses set in RViz go to the robots, through this master's gateway")  # fmt: skip
    return parser.parse_args(words)
