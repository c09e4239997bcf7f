"""Node deaths are parsed from roslaunch's output."""

from pioneer_demo.processes.launch_log import NodeDeath, node_deaths, restarted_nodes

KILLED = (
    "\x1b[31m[pioneer1/move_base-4] process has died [pid 4242, exit code -9, cmd /ws/devel/lib/nav_bundle/move_base "
    "__name:=move_base __log:=/log/x.log].\nlog file: /log/pioneer1-move_base-4*.log\x1b[0m\n"
)


def test_a_killed_node_is_found_with_its_status_and_log():
    assert node_deaths("process[a-1]: started\n" + KILLED) == [
        NodeDeath("pioneer1/move_base", 4242, -9, "/log/pioneer1-move_base-4*.log")
    ]


def test_the_death_of_a_required_node_or_a_master_names_it():
    text = (
        "\x1b[31m====REQUIRED process [gateway-2] has died!\n"
        "process has died [pid 42, exit code -9, cmd /ws/gateway.py].\n"
        "log file: /log/gateway-2*.log\nInitiating shutdown!\n====\x1b[0m\n"
    )
    assert node_deaths(text) == [NodeDeath("gateway", 42, -9, "/log/gateway-2*.log")]
    assert node_deaths(text.replace("gateway-2", "master"))[0].name == "master"


def test_nodes_that_finish_cleanly_are_no_deaths():
    assert (
        node_deaths("[spawn_pioneer1-3] process has finished cleanly\nlog file: /log/spawn*.log\n")
        == []
    )


def test_a_death_without_log_or_status_is_still_one():
    assert node_deaths("[amcl-2] process has died without exit code [pid 7, cmd amcl].\n") == [
        NodeDeath("amcl", 7, None, "")
    ]


def test_several_deaths_come_in_order():
    assert [death.name for death in node_deaths(KILLED + KILLED.replace("move_base", "amcl"))] == [
        "pioneer1/move_base",
        "pioneer1/amcl",
    ]


def test_a_node_that_is_started_again_is_found():
    text = (
        KILLED
        + "[pioneer1/move_base-4] restarting process\nprocess[pioneer1/move_base-4]: started with pid [7]\n"
    )
    assert restarted_nodes(text) == ["pioneer1/move_base"]
    assert restarted_nodes(KILLED) == []
