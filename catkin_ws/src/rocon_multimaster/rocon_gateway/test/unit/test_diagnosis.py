"""Findings: each fault comes with its fix, and only faults make the check fail."""

import pytest

from rocon_gateway.commands.table import listing, table
from rocon_gateway.doctor import diagnosis
from rocon_gateway.doctor.diagnosis import Finding, Level
from rocon_gateway.doctor.examination import Contact, Examination


def test_a_door_to_ros_2_is_named_with_what_does_not_cross() -> None:
    states = [
        ("door", "ROS 2 domain 0 is open", True),
        ("/a to ROS 2", "it does not cross: x", False),
    ]
    whole, fault = diagnosis.of_door("/ros2_door", states)
    assert (whole.level, fault.level) == (Level.OK, Level.WARNING)
    assert "1 of 2 states" in whole.what
    assert fault.what == "/a to ROS 2: it does not cross: x"


def test_each_path_with_a_small_mtu_is_one_finding() -> None:
    limited = "at most 5 Hz; full packets do not arrive"
    rules = [("robot", limited), ("robot", "full packets do not arrive")]
    (finding,) = diagnosis.of_paths(rules)
    assert finding.level == Level.WARNING
    assert finding.what == "the path to gateway 'robot': full packets do not arrive"
    assert "MTU" in finding.fix


@pytest.mark.parametrize(
    ("finding", "level", "fix"),
    [
        (diagnosis.of_contact(Contact("the hub", "base", 6380, "10.0.0.1"), "x"), Level.OK, ""),
        (diagnosis.of_contact(Contact("the hub", "base", 6380), "x"), Level.FAULT, "/etc/hosts"),
        (
            diagnosis.of_contact(
                Contact("the hub", "base", 6380, "10.0.0.1", "no answer"), "open it"
            ),
            Level.FAULT,
            "open",
        ),
        (diagnosis.of_own_name("aadi1", ""), Level.FAULT, "/etc/hosts"),
        (diagnosis.of_own_name("aadi1", "127.0.1.1"), Level.OK, ""),
        (
            *diagnosis.of_advertised_host("robot", "127.0.0.1", ["127.0.0.1", "10.0.0.2"]),
            Level.FAULT,
            "ROS_IP",
        ),
        (diagnosis.of_clock(-0.05), Level.OK, ""),
        (diagnosis.of_clock(3.0), Level.WARNING, "chrony"),
        (
            diagnosis.of_python("/opt/conda/bin/python3", False, "/usr/bin/python3"),
            Level.WARNING,
            "PATH=/usr/bin:",
        ),
        (diagnosis.of_python("/usr/bin/python3", True, "/usr/bin/python3"), Level.OK, ""),
    ],
)
def test_every_fault_has_a_fix(finding: Finding, level: Level, fix: str) -> None:
    assert finding.level == level
    assert fix in finding.fix
    assert bool(finding.fix) == (level != Level.OK)


def test_a_relay_on_the_loopback_is_well_as_long_as_all_gateways_are_there() -> None:
    assert diagnosis.of_advertised_host("robot", "127.0.0.1", ["127.0.0.1", "localhost"]) == []
    assert diagnosis.of_advertised_host("robot", "10.0.0.1", ["127.0.0.1"]) == []


def seen(gateway: str, *contacts: Contact, clock: float = 0.0, works: bool = True) -> Examination:
    return Examination(
        gateway, clock, gateway, "10.0.0.1", "/usr/bin/python3", works, "/usr/bin/python3", contacts
    )


def test_what_each_gateway_sees_becomes_one_line_a_fault_and_one_cell_a_link() -> None:
    reached = Contact("b", "10.0.0.2", 7000, "10.0.0.2")
    cut = Contact("a", "alpha", 7000, "10.0.0.1", "timed out")
    unnamed = Contact("a", "alpha", 7000)
    views = [seen("a", reached, clock=-3.0), seen("b", cut, works=False), seen("c", unnamed)]
    alive = ["a", "b", "c", "d"]
    assert diagnosis.matrix(views, alive).splitlines() == [
        "   FROM \\ TO  1        2   3  4",
        "1  a          -        ok  ?  ?",
        "2  b          NO       -   ?  ?",
        "3  c          no name  ?   -  ?",
        "4  d          ?        ?   ?  ?",
    ]
    text = diagnosis.report(diagnosis.of_examinations(views, alive))
    for fault in (
        "gateway 'd' is on the hub, but does not answer the doctor\n         → check its log",
        "gateway 'a', seen at gateway 'b', at alpha:7000: timed out\n         → let TCP port 7000 through the firewall",
        "gateway 'a', seen at gateway 'c', at alpha:7000: the name does not resolve\n         → put 'alpha'",
        "the hub's clock is 3.000 s behind that at gateway 'a'\n         → let chrony",
        "/usr/bin/python3, cannot import rospy\n         → export PATH=/usr/bin:$PATH at gateway 'b'",
        "gateway 'c' is not known at gateway 'b'\n         → run the doctor again",
    ):
        assert fault in text, text


def test_a_view_from_here_is_a_row_of_its_own_and_all_well_is_one_line() -> None:
    here = seen(diagnosis.HERE, Contact("a", "x", 1, "y"))
    assert diagnosis.matrix([here], ["a"]).splitlines()[-1] == "   (here)     ok"
    findings = diagnosis.of_examinations([here, seen("a")], ["a"])
    assert diagnosis.status(findings) == 0
    assert "1 relays answer here" in diagnosis.report(findings)


def test_gateways_of_one_name_are_found_by_their_base_name() -> None:
    (finding,) = diagnosis.of_duplicates(
        ["robot_gateway" + "a" * 32, "robot_gateway" + "b" * 32, "other"]
    )
    assert "2 gateways are called 'robot_gateway'" in finding.what


def test_the_exit_status_is_for_faults_and_the_last_line_counts() -> None:
    findings = [Finding(Level.OK, "a"), Finding(Level.WARNING, "b", "mend b")]
    assert diagnosis.status(findings) == 0
    assert diagnosis.status([*findings, Finding(Level.FAULT, "c", "mend c")]) == 1
    lines = diagnosis.report(findings).splitlines()
    assert lines[2].endswith("→ mend b")
    assert lines[-1] == "2 checks, 1 to fix"


def test_tables_are_as_wide_as_their_contents() -> None:
    assert table(("A", "B"), [("long", "x"), ("s", "")]).splitlines() == ["A     B", "long  x", "s"]
    assert listing("pulled", ["a", "b"]) == "pulled (2)\n  a\n  b"
