"""Findings: each fault comes with its fix, and only faults fail."""

import pytest

from rocon_gateway.core import diagnosis
from rocon_gateway.core.diagnosis import Contact, Finding, Level
from rocon_gateway.core.table import listing, table


@pytest.mark.parametrize(
    ("finding", "level", "fix"),
    [
        (diagnosis.of_contact(Contact("the hub", "base", 6380, "10.0.0.1"), "x"), Level.OK, ""),
        (diagnosis.of_contact(Contact("the hub", "base", 6380), "x"), Level.FAULT, "/etc/hosts"),
        (
            diagnosis.of_contact(Contact("the hub", "base", 6380, "10.0.0.1", "no answer"), "open it"),
            Level.FAULT,
            "open",
        ),
        (diagnosis.of_own_name("aadi1", "", True), Level.FAULT, "/etc/hosts"),
        (diagnosis.of_own_name("aadi1", "127.0.1.1", True), Level.OK, ""),
        (diagnosis.of_advertised_host("127.0.0.1", ["127.0.0.1"]), Level.OK, ""),
        (diagnosis.of_advertised_host("127.0.0.1", ["10.0.0.2"]), Level.FAULT, "ROS_IP"),
        (diagnosis.of_clock(-0.05), Level.OK, ""),
        (diagnosis.of_clock(3.0), Level.WARNING, "chrony"),
        (diagnosis.of_python("/opt/conda/bin/python3", False, "/usr/bin/python3"), Level.WARNING, "PATH=/usr/bin:"),
        (diagnosis.of_python("/usr/bin/python3", True, "/usr/bin/python3"), Level.OK, ""),
    ],
)
def test_every_fault_has_a_fix(finding: Finding, level: Level, fix: str) -> None:
    assert finding.level == level
    assert fix in finding.fix
    assert bool(finding.fix) == (level != Level.OK)


def test_gateways_of_one_name_are_found_by_their_base_name() -> None:
    (finding,) = diagnosis.of_duplicates(["robot_gateway" + "a" * 32, "robot_gateway" + "b" * 32, "other"])
    assert "2 gateways are called 'robot_gateway'" in finding.what


def test_the_exit_status_is_for_faults_and_the_last_line_counts() -> None:
    findings = [Finding(Level.OK, "a"), Finding(Level.WARNING, "b", "mend b")]
    assert diagnosis.status(findings) == 0
    assert diagnosis.status([*findings, Finding(Level.FAULT, "c", "mend c")]) == 1
    lines = diagnosis.report(findings).splitlines()
    assert lines[2].endswith("→ mend b")
    assert lines[-1] == "3 things looked at, 1 to mend".replace("3", "2")


def test_tables_are_as_wide_as_their_contents() -> None:
    assert table(("A", "B"), [("long", "x"), ("s", "")]).splitlines() == ["A     B", "long  x", "s"]
    assert listing("pulled", ["a", "b"]) == "pulled (2)\n  a\n  b"
