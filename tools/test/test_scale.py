"""The figures of ``./pioneer bench containers``."""

import contextlib

import pytest

from containers import scale
from containers.engine import Computer

ROW = {"robots": 5.0, "factor": 1.0, "cpu_s_a_sim_s": 1.0, "robot_cpu": 0.13}


def test_each_figure_stands_beside_its_goal():
    lines = scale.table(
        [ROW, {**ROW, "robots": 15.0, "cpu_s_a_sim_s": 6.0, "factor": 0.89}]
    ).splitlines()[2:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    found = {(robots, what): (value, goal, holds) for robots, what, value, _, goal, holds in cells}
    assert found["5", "real-time factor"] == ("1", "", "")
    assert found["15", "real-time factor"] == ("0.89", "≥ 0.9", "no")
    assert found["5", "a robot's computer, mean"] == ("0.13", "≤ 0.12", "no")
    growth = "CPU of the largest fleet / of as many robots at the smallest's cost"
    assert found["15", growth] == ("2", "≤ 1.05", "no")


class Computers:
    """Computers that are queried late, each later than the one before, while simulated time runs at half speed."""

    def __init__(self, robots):
        self.robots, self.wall = robots, 100.0

    def pioneer(self, *_words):
        return f"{self.robots} robots drive after 12 s"

    def memory(self, _computer):
        return 2e8

    def computers(self):
        places = {scale.BASE: "vm", "aadi1": "vm", "aadi2": "node1", "aadi3": "node2"}
        return {
            name: Computer(name, "c", "running", "", {}, "i", node) for name, node in places.items()
        }

    def execute(self, _computer, *command):
        assert "ServiceProxy" in command[-1]
        return '{"aadi1_gateway": 1.0, "aadi2_gateway": 2.0, "aadi3_gateway": 4.0, "studio_gateway": 9.0}'

    @contextlib.contextmanager
    def asked(self, computer, *command):
        yield lambda: self.answer(computer, command[0])

    def answer(self, computer, program):
        self.wall += 1.7
        if program == "python3":
            return f"{self.wall / 2} {self.wall}\n"
        rate = 0.3 if computer == scale.BASE else 0.1
        eth = f"eth0: {int(self.wall * 1000)} 0 0 0 0 0 0 0 {int(self.wall * 500)} 0"
        return f"{self.wall} 1.0\n{eth}\nusage_usec {int(self.wall * rate * 1e6)}\n"


def test_figures_do_not_depend_on_how_long_the_questions_take(monkeypatch):
    computers = Computers(3)
    monkeypatch.setattr(
        scale.time, "sleep", lambda seconds: setattr(computers, "wall", computers.wall + seconds)
    )
    row = scale.measure(computers, 3)
    assert row["factor"] == pytest.approx(0.5)
    assert row["cpu_s_a_sim_s"] == pytest.approx(2 * (0.3 + 3 * 0.1), rel=1e-3)
    assert row["robot_cpu"] == pytest.approx(0.2, rel=1e-3)
    assert (row["robot_in_kb"], row["robot_out_kb"]) == pytest.approx((2.0, 1.0), rel=1e-3)
    assert (row["trip_ms"], row["far_trip_ms"]) == (1.0, 3.0)


def test_a_figure_of_only_one_of_two_fleets_leaves_the_others_cell_empty():
    lines = scale.comparison(
        {"robots": 6.0, "factor": 0.8}, {"robots": 6.0, "factor": 0.8, "far_trip_ms": 2.5}
    )
    assert lines.splitlines()[0] == "| 6 robots | unit | compose | swarm |"
    assert lines.splitlines()[2] == "| real-time factor |  | 0.8 | 0.8 |"
    assert lines.endswith("on two machines | ms |  | 2.5 |")
