"""The dashboard page: NiceGUI builds the layout, ``static/fleet.js`` draws the data from the WebSocket ``/live``."""

import asyncio
import functools
import json
import os
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import rospy
import yaml
from nicegui import ui

from pioneer_description.core.fleet_view import turned
from pioneer_description.nodes.rviz_snapshot import TEMPLATE
from pioneer_web.page.camera import image_topics, next_image
from pioneer_web.shared_call import SharedCalls

DOCTOR_LIMIT = 60.0
"""Time-out for the examination of all gateways [s]."""
_TOOLS = (
    ("view", "pan_tool", "Move the view; click a robot to select it"),
    ("drive", "near_me", "Send the selected robots: press at the place, drag to the heading"),
    ("append", "playlist_add", "Append a waypoint for the selected robots"),
    ("locate", "pin_drop", "Set the selected robot's initial pose: press, drag"),
    ("spawn", "add_box", "Put a box into the simulated world"),
)
_LOG = """<select id="least" aria-label="least severity"><option value="info">all<option value="warning">warnings
<option value="error">errors</select><input id="filter" placeholder="filter: aadi1 move_base …" aria-label="filter">
<div id="log"></div>"""
_SLIDER = (
    '<label id="replay" hidden>Replay <input type="range" min="0" step="0.1"><span></span></label>'
)
LOOK_AGAIN = 0.3
"""Interval between two camera images [s]."""
_LOOKS = 4
"""Number of camera images that are awaited at the same time."""
_ACTIONS = (
    ("pause", "pause"),
    ("resume", "play_arrow"),
    ("step", "skip_next"),
    ("reset", "restart_alt"),
)


_shared = SharedCalls()
_looking = ThreadPoolExecutor(_LOOKS, "camera")


def colours(count: int) -> list[str]:
    """Returns the robots' colours in RViz, as ``rgb(r, g, b)``."""
    groups = [
        one
        for one in yaml.safe_load(TEMPLATE.read_text())["Visualization Manager"]["Displays"]
        if "Displays" in one
    ]
    scans = [
        next(one["Color"] for one in group["Displays"] if one["Name"] == "Scan") for group in groups
    ]
    parts = (
        turned(scans[number % len(scans)], 0.065 * (number // len(scans)))
        for number in range(count)
    )
    return [f"rgb({part.replace(';', ',')})" for part in parts]


def build(on_open: Callable[[], None]) -> None:
    """Registers the page; ``on_open`` is called when a browser requests it."""

    @ui.page("/")
    def fleet_page() -> None:
        on_open()
        # In the head, so that fleet data already arrives while NiceGUI's scripts load.
        ui.add_head_html(
            '<link rel="stylesheet" href="/static/fleet.css"><script src="/static/fleet.js"></script>'
        )
        dark = ui.dark_mode(None)
        _header(dark)
        _tools()
        ui.html(_SLIDER, sanitize=False).style("width: 100%")
        with ui.element("main").props("id=main"):
            ui.html(
                '<canvas id="map" tabindex="0" aria-label="Map of the fleet"></canvas>',
                sanitize=False,
            ).props("id=stage")
            with ui.element("section").props("id=side"):
                _tabs()
        ui.html('<div id="answers" role="status"></div>', sanitize=False)


def _header(dark: ui.dark_mode) -> None:
    with ui.header().props("id=header"):
        ui.html('<b>Fleet</b> <span id="clock">connecting …</span>', sanitize=False)
        ui.space()
        ui.button(icon="contrast", on_click=lambda: dark.set_value(not dark.value)).props(
            'flat dense color=white aria-label="dark or light"'
        )
        _act("", "logout", "flat dense color=white", "logout", "Log out")
        _act("RELEASE", "release-all", "outline dense color=white")
        _act("STOP ALL", "stop-all", "dense color=negative")


def _act(label: str, act: str, props: str, icon: str | None = None, tip: str = "") -> None:
    button = ui.button(label, icon=icon).props(
        f'{props} data-act={act} aria-label="{tip or label}"'
    )
    if tip:
        button.tooltip(tip)


def _tools() -> None:
    with ui.row().props("id=tools"):
        for name, icon, tip in _TOOLS:
            _act("", f"tool-{name}", "flat dense", icon, tip)
        _act(
            "",
            "cancel",
            "flat dense",
            "playlist_remove",
            "Drop the waypoints of the selected robots",
        )
        _act(
            "",
            "patrol",
            "flat dense",
            "repeat",
            "Repeat the waypoints of the selected robots, or stop repeating them",
        )
        _act("", "follow", "flat dense", "gps_fixed", "Follow the selected robot")
        _act("", "fit", "flat dense", "fit_screen", "Show the whole map")
        _act("STOP", "stop", "dense color=negative", None, "Stop the selected robots and hold them")
        _act("RELEASE", "release", "outline dense", None, "Release the selected robots")
        ui.space()
        _act(
            "",
            "record",
            "flat dense",
            "fiber_manual_record",
            "Record the fleet, or end the recording",
        )
        ui.button(icon="photo_camera", on_click=_camera).props(
            'flat dense aria-label="Camera images"'
        ).tooltip("Camera images")
        for name, icon in _ACTIONS:
            _act("", f"simulate-{name}", "flat dense", icon, f"Simulator: {name}")


def _tabs() -> None:
    with ui.tabs().props("dense align=left no-caps") as tabs:
        for name in ("Robots", "Network", "Log"):
            ui.tab(name)
    with ui.tab_panels(tabs, value="Robots").props("keep-alive"):
        with ui.tab_panel("Robots"):
            ui.html('<div id="robots"></div>', sanitize=False)
        with ui.tab_panel("Network"):
            ui.html('<div id="network"></div>', sanitize=False)
            ui.button("Ask the doctor", icon="medical_services", on_click=_doctor).props(
                "dense outline no-caps"
            )
        with ui.tab_panel("Log"):
            ui.html(_LOG, sanitize=False)


async def _camera() -> None:
    """Shows live camera images while the dialog is open."""
    topics = await _shared.result(image_topics, functools.partial(_look, image_topics))
    with ui.dialog(value=True) as dialog, ui.card().classes("camera"):
        words = ui.label(
            "" if topics else "There are no camera images (sensor_msgs/Image) on this master."
        )
        chosen = ui.select(topics, value=topics[0] if topics else None).props("dense options-dense")
        picture = ui.image().props("no-transition no-spinner")

        async def look() -> None:
            try:
                topic = chosen.value
                picture.set_source(
                    await _shared.result(topic, functools.partial(_look, next_image, topic))
                )
                words.set_text("")
            except (rospy.ROSException, ValueError) as error:
                words.set_text(str(error))

        looking = ui.timer(LOOK_AGAIN, look, active=bool(topics))
        chosen.set_visibility(bool(topics))
        ui.button("Close", on_click=dialog.close).props("dense")
    dialog.on("hide", looking.cancel)


async def _doctor() -> None:
    """Runs the doctor on all gateways and shows faults and fixes."""
    with ui.dialog(value=True) as dialog, ui.card():
        ui.label("What keeps gateways from working").classes("text-h6")
        waiting = ui.spinner()
        findings = await _shared.result(_examine, _examine)
        waiting.delete()
        for one in findings:
            ui.label(f"{one['level']}: {one['what']}").classes(f"finding {one['level']}")
            if one["fix"]:
                ui.label(one["fix"]).classes("fix")
        ui.button("Close", on_click=dialog.close).props("dense")


async def _look(call: Callable[..., Any], *arguments: Any) -> Any:
    """Calls a function that waits for the master or a camera in a thread that commands do not need."""
    return await asyncio.get_running_loop().run_in_executor(_looking, call, *arguments)


async def _examine() -> list[dict[str, Any]]:
    """Runs the doctor, as a process that ends with its time-out."""
    command = ("rosrun", "rocon_gateway", "doctor", "--json")
    pipe, null = asyncio.subprocess.PIPE, asyncio.subprocess.DEVNULL
    try:
        process = await asyncio.create_subprocess_exec(
            *command, stdout=pipe, stderr=null, start_new_session=True
        )
    except OSError as error:
        return _no_answer(str(error))
    try:
        text, _ = await asyncio.wait_for(process.communicate(), DOCTOR_LIMIT)
        return list(json.loads(text)["findings"])
    except TimeoutError:
        return _no_answer(f"timed out after {DOCTOR_LIMIT:.0f} s")
    except (ValueError, KeyError, TypeError) as error:
        return _no_answer(str(error))
    finally:
        if process.returncode is None:
            os.killpg(process.pid, signal.SIGKILL)


def _no_answer(reason: str) -> list[dict[str, Any]]:
    return [{"level": "fault", "what": f"the doctor does not answer: {reason}", "fix": ""}]
