"""Masters in the test's process are real and independent, and leave nothing behind."""

import threading
import warnings

import rosmaster.util

from pioneer_harness.masters import Master, is_running
from pioneer_harness.port import is_free


def test_several_masters_live_at_once_and_know_nothing_of_each_other():
    with Master() as first, Master() as second:
        first.set_param("/robot", "pioneer1")
        second.set_param("/robot", "pioneer2")
        assert (first.get_param("/robot"), second.get_param("/robot")) == ("pioneer1", "pioneer2")
        assert first.port != second.port


def test_registrations_show_in_the_system_state():
    with Master() as master:
        master.proxy("/talker").registerPublisher(
            "/chatter", "std_msgs/String", "http://127.0.0.1:1/"
        )
        publishers, subscribers, services = master.system_state()
        assert publishers == {"/chatter": ["/talker"]}
        assert not subscribers
        assert not services


def test_a_stopped_master_answers_no_more_and_frees_its_port_home_and_threads():
    before = threading.active_count()
    with Master() as master:
        assert is_running(master.uri)
        assert master.home.is_dir()
    assert not is_running(master.uri)
    assert is_free(master.port)
    assert not master.home.exists()
    assert threading.active_count() <= before + 3  # rosmaster's workers exit at their next poll


def test_the_environment_points_nodes_at_the_master_and_at_its_home():
    with Master() as master:
        environment = master.environment
        assert environment["ROS_MASTER_URI"] == master.uri
        assert environment["ROS_IP"] == "127.0.0.1"
        assert environment["ROS_HOME"] == str(master.home)
        assert "PATH" in environment


def test_stopping_twice_is_harmless():
    with Master() as master:
        master.stop()


def test_a_connection_of_a_worker_that_ends_late_is_not_left_open():
    with Master() as master, warnings.catch_warnings(record=True) as complaints:
        warnings.simplefilter("always")
        worker = threading.Thread(
            target=lambda: rosmaster.util.xmlrpcapi(master.uri).getPid("/worker")
        )
        worker.start()
        worker.join()
        del worker
        assert not [one for one in complaints if one.category is ResourceWarning]
