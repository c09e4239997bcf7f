"""Parameters across two relays: they cross once, complete, and within limits."""

import pytest
from relay_side import wait_for

from pioneer_harness.wait import wait_until
from rocon_relay.connection import ANY, Export, Import, LinkState, Subject
from rocon_relay.parameter_copy import MAX_PARAMETER

# rosmaster leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

VALUE = {
    "text": "ä<&>" * 20000,
    "number": -3,
    "half": 0.5,
    "flags": [True, False],
    "tree": {"leaf": ""},
}


def imported(source, name):
    return Import(name, ANY, ANY, "source", "", source.address, subject=Subject.PARAMETER)


def connect(source, sink, name):
    source.relay.apply({Export(name, ANY, "", "sink", subject=Subject.PARAMETER)}, set())
    sink.relay.apply(set(), {imported(source, name)})


def test_a_parameter_is_copied_once_and_whole(relays, source_master, sink_master):
    source, sink = relays("source"), relays("sink")
    source_master.set_param("/robot", VALUE)
    connect(source, sink, "/robot")
    wait_for(sink, LinkState.ACTIVE)
    assert sink_master.proxy().getParam("/robot") == VALUE
    assert source.link().messages == 1
    source_master.set_param("/robot/number", 4)
    sink_master.set_param("/robot/half", 9.0)
    sink.relay.apply(set(), {imported(source, "/robot")})
    assert sink_master.proxy().getParam("/robot")["number"] == -3
    assert sink_master.proxy().getParam("/robot")["half"] == 9.0
    assert source.link().messages == 1
    sink.relay.refresh()
    assert sink.state() == [LinkState.ACTIVE]
    sink.relay.restore()
    wait_until(
        lambda: sink_master.proxy().getParam("/robot")["number"] == 4, "copied for a new master", 5
    )
    assert source.link().messages == 2, "a master that only hung keeps what was changed there"


def test_a_parameter_that_is_not_there_is_waited_for(relays, source_master, sink_master):
    source, sink = relays("source"), relays("sink")
    connect(source, sink, "/late")
    wait_for(sink, LinkState.NO_PARAMETER)
    source_master.set_param("/late", 1)
    wait_for(sink, LinkState.ACTIVE)
    assert sink_master.proxy().getParam("/late") == 1


def test_too_long_a_parameter_is_refused(relays, source_master):
    source, sink = relays("source"), relays("sink")
    source_master.set_param("/long", "x" * MAX_PARAMETER)
    connect(source, sink, "/long")
    wait_for(sink, LinkState.REFUSED)
    assert f"more than {MAX_PARAMETER}" in sink.link().reason


def test_what_is_not_exported_is_not_read(relays, source_master, sink_master):
    source, sink = relays("source", patience=0.05), relays("sink")
    source_master.set_param("/secret", 1)
    sink.relay.apply(set(), {imported(source, "/secret")})
    wait_for(sink, LinkState.REFUSED)
    assert "exports no parameter of /secret to sink" in sink.link().reason
    assert not sink_master.proxy().hasParam("/secret")
