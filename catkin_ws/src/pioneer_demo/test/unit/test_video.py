"""The video of a run: what is recorded, what a frame shows, what ffmpeg receives and produces."""

import json
import os
import subprocess
import types

import numpy as np
import pytest
from PIL import ImageColor

from pioneer_demo.error import VideoError
from pioneer_demo.observer import conversions
from pioneer_demo.observer.recording import Recording
from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.report import colour, video
from pioneer_demo.scenario.floor import Floor
from pioneer_demo.scenario.waypoint import Leg
from pioneer_fleet.geometry import Pose
from pioneer_fleet.monitor.conversions import mount_of

FREE = np.ones((60, 100), bool)
FREE[0] = FREE[-1] = FREE[:, 0] = FREE[:, -1] = False
HEIGHT = 576 + 48
"""Height of a frame: the floor, plus a one-line legend above the line with the time."""
FLOOR = Floor(0.1, -5.0, -3.0, FREE, ~FREE)


@pytest.fixture
def recording():
    made = Recording()
    for tick in range(201):
        made.add_pose("pioneer1", tick * 0.05, Pose(-4.0 + tick * 0.03, 0.0))
    made.add_scan("pioneer1", 9.95, np.array([(2.0, 1.0)], np.float32))
    return made


@pytest.fixture
def robot():
    track = RobotTrack("pioneer1")
    track.assign([Leg(Pose(x, 2.0), np.empty((0, 2)), 3.0) for x in (-3.0, 3.0)])
    track.visits[0].reached, track.visits[0].time = True, 6.0
    return track


def test_a_recording_keeps_ten_poses_a_second_and_answers_in_between(recording):
    assert len(recording._poses["pioneer1"]) == 101
    assert recording.pose("pioneer1", 0.53).x == pytest.approx(-4.0 + 0.6 * 0.53, abs=1e-6)
    assert recording.pose("pioneer1", -1.0) is None
    assert recording.pose("pioneer2", 1.0) is None
    assert len(recording.times(10)) == 101
    assert len(Recording().times(10)) == 0


def test_a_frame_shows_robot_trail_and_scan_where_they_are(recording, robot):
    stage = video._Stage(FLOOR, recording, [robot])
    assert (stage.width, stage.height) == (960, HEIGHT)
    for time in (0.0, 5.0, 10.0):
        picture = np.frombuffer(stage.frame(time), np.uint8).reshape(HEIGHT, 960, 3)
    paint = ImageColor.getrgb(colour.of_robot(0))

    def at(x, y):
        return tuple(int(part) for part in picture[round((3.0 - y) * 96), round((x + 5.0) * 96)])

    assert at(2.0, 0.0) == paint, "the robot at its end"
    assert at(-2.0, 0.0) == paint, "the trail"
    assert at(-2.0, 1.0) == ImageColor.getrgb(colour.FREE)
    light = tuple((2 * part + 255) // 3 for part in paint)
    assert at(3.97, 1.0) == light, (
        "the scan, two metres ahead and one to the left of where it was taken"
    )
    assert at(-4.97, 0.0) == ImageColor.getrgb(colour.WALL)


def test_goals_are_filled_once_reached_and_the_plan_ends_with_the_last(recording, robot):
    recording.add_plan("pioneer1", 1.0, [(-4.0 + step / 20, -2.0) for step in range(100)])
    paint, white = ImageColor.getrgb(colour.of_robot(0)), (255, 255, 255)

    def seen(time):
        picture = np.frombuffer(video._Stage(FLOOR, recording, [robot]).frame(time), np.uint8)
        rows = picture.reshape(HEIGHT, 960, 3)
        goals = [tuple(map(int, rows[96 - 6, round((x + 5.0) * 96)])) for x in (-3.0, 3.0)]
        return goals, bool((rows[5 * 96, :600] == paint).all(axis=1).any())

    assert seen(0.5) == ([white, white], False)
    assert seen(2.0) == ([white, white], True)
    assert seen(6.0) == ([paint, white], True)
    robot.visits[1].reached, robot.visits[1].time = True, 9.0
    assert seen(9.5) == ([paint, paint], False)


def test_the_legend_takes_as_many_lines_as_its_robots_need(recording):
    many = [RobotTrack(f"pioneer{number}") for number in range(1, 16)]
    assert video._Stage(FLOOR, recording, many).height == HEIGHT + 2 * 24


def test_ffmpeg_gets_every_frame_and_its_failure_is_one_line(
    recording, robot, tmp_path, monkeypatch
):
    program = tmp_path / "ffmpeg"
    program.write_text('#!/bin/sh\nfor last; do :; done\nexec cat > "$last"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    film = tmp_path / "run.mp4"
    assert video.write_video(FLOOR, recording, [robot], film) == 101
    assert film.stat().st_size == 101 * 960 * HEIGHT * 3
    program.write_text("#!/bin/sh\necho first >&2\necho no such encoder >&2\nexit 1\n")
    with pytest.raises(VideoError, match=r"run.mp4: ffmpeg failed: no such encoder"):
        video.write_video(FLOOR, recording, [robot], film)


def test_the_film_is_h264_of_every_frame_and_shows_the_robot_where_it_ends(
    recording, robot, tmp_path
):
    film = tmp_path / "run.mp4"
    frames = video.write_video(FLOOR, recording, [robot], film)
    command = ["ffprobe", "-v", "error", "-show_streams", "-of", "json", str(film)]
    [stream] = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)[
        "streams"
    ]
    assert (stream["codec_name"], stream["width"], stream["height"]) == ("h264", 960, HEIGHT)
    assert int(stream["nb_frames"]) == frames == 101
    assert float(stream["duration"]) == pytest.approx(10.1)
    command = ["ffmpeg", "-v", "error", "-i", str(film), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    shown = np.frombuffer(subprocess.run(command, capture_output=True, check=True).stdout, np.uint8)
    first, last = shown.reshape(frames, HEIGHT, 960, 3)[
        [0, -1], round(3.0 * 96), round((2.0 + 5.0) * 96)
    ]
    assert first == pytest.approx(ImageColor.getrgb(colour.FREE), abs=12)
    assert last == pytest.approx(ImageColor.getrgb(colour.of_robot(0)), abs=40), (
        "but for the film's compression"
    )


def test_without_ffmpeg_one_line_says_what_to_do(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(
        VideoError, match="--video needs ffmpeg, which is not installed: apt install ffmpeg"
    ):
        video.encoder()


def test_hits_are_given_on_the_robot_whose_laser_sits_ahead():
    joint = "<joint name='j'><origin xyz='0.1 0 0.2' rpy='0 0 0'/><parent link='base'/><child link='laser'/></joint>"
    mount = mount_of(f"<robot name='r'>{joint}</robot>", "laser")
    scan = types.SimpleNamespace(
        ranges=(1.0, float("inf"), 2.0),
        angle_min=0.0,
        angle_increment=np.pi / 2,
        range_min=0.1,
        range_max=9.0,
    )
    hits = conversions.hits_from_scan(scan, mount)
    assert hits == pytest.approx(np.array([(1.1, 0.0), (-1.9, 0.0)]), abs=1e-6)
