"""Files that a hub stores for a gateway: the next gateway of that name receives them, on any computer."""

import logging
from collections.abc import Iterator
from pathlib import Path

import pytest
import redis
from hub_seat import REQUEST, Bench

from pioneer_harness.wait import wait_until
from rocon_gateway.hub.kept_folder import KeptFolder
from rocon_hub_protocol.key import GATEWAYS_KEY, alive_key, kept_key, record_key, requests_key

KEY = kept_key("aadi1_gateway")


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.close()


def folder(path: Path) -> KeptFolder:
    return KeptFolder(path, logging.getLogger("rosout"))


def test_files_of_a_gateway_that_left_are_there_before_the_next_of_its_name_has_joined(
    bench: Bench, tmp_path: Path
) -> None:
    here, there = folder(tmp_path / "here"), folder(tmp_path / "there")
    first = bench.seat("aadi1_gateway", restore=here.restore)
    (tmp_path / "here" / "correction.json").write_text("somewhere")
    first.keep(here.text())
    wait_until(lambda: bench.client.get(KEY) == here.text(), "the copy on the hub", 5)
    first.leave()
    bench.seat("aadi1_gateway", "2", restore=there.restore)
    assert (tmp_path / "there" / "correction.json").read_text() == "somewhere"
    assert bench.client.get(KEY) == there.text()


def test_an_emptied_hub_gets_the_files_again_and_loses_those_that_are_removed(
    bench: Bench, tmp_path: Path
) -> None:
    here = folder(tmp_path / "here")
    (tmp_path / "here" / "correction.json").write_text("somewhere")
    seat = bench.seat("aadi1_gateway", restore=here.restore)
    wait_until(lambda: bench.client.get(KEY) == here.text(), "the copy on the hub", 5)
    seat.lose()
    bench.client.delete(KEY)
    seat.find()
    wait_until(lambda: bench.client.get(KEY) == here.text(), "the copy on the hub again", 5)
    (tmp_path / "here" / "correction.json").unlink()
    seat.keep(here.text())
    wait_until(lambda: bench.client.get(KEY) is None, "nothing on the hub", 5)


def test_something_else_in_its_place_does_not_keep_a_gateway_from_the_hub(
    bench: Bench, tmp_path: Path
) -> None:
    bench.client.sadd(KEY, "no text")
    bench.seat("aadi1_gateway", restore=folder(tmp_path / "here").restore)
    assert not list((tmp_path / "here").iterdir())


def test_files_are_removed_from_a_full_hub_which_keeps_the_gateway(
    bench: Bench, tmp_path: Path
) -> None:
    """A full Redis refuses every transaction, so the removal once cost the gateway its place on the hub."""
    here = folder(tmp_path / "here")
    (tmp_path / "here" / "correction.json").write_text("somewhere")
    seat = bench.seat("aadi1_gateway", restore=here.restore)
    wait_until(lambda: bench.client.get(KEY) == here.text(), "the copy on the hub", 5)
    bench.client.config_set("maxmemory", "1mb")
    with pytest.raises(redis.ResponseError, match="OOM"):
        bench.client.set("junk", "x")
    (tmp_path / "here" / "correction.json").unlink()
    seat.keep(here.text())
    wait_until(lambda: bench.client.get(KEY) is None, "nothing on the hub", 5)
    assert seat.view.connected
    assert seat.tries == 1
    assert not seat.complaints


def test_nothing_is_removed_from_a_full_hub_under_a_name_that_another_gateway_has(
    bench: Bench, tmp_path: Path
) -> None:
    seat = bench.seat("aadi1_gateway", restore=folder(tmp_path / "here").restore)
    bench.client.set(KEY, "its files")
    bench.client.set(alive_key("aadi1_gateway"), "another instance")
    bench.client.config_set("maxmemory", "1mb")
    assert not seat.session.keep("")
    assert bench.client.get(KEY) == "its files"


def test_a_gateway_that_leaves_a_full_hub_leaves_nothing_behind(bench: Bench) -> None:
    base, robot = bench.seat("base"), bench.seat("robot")
    robot.tell(base=REQUEST)
    wait_until(lambda: base.hears("robot") == REQUEST, "the request", 5)
    bench.client.config_set("maxmemory", "1mb")
    robot.leave()
    assert not bench.client.exists(record_key("robot"), alive_key("robot"), requests_key("base"))
    assert bench.client.smembers(GATEWAYS_KEY) == {"base"}
    wait_until(lambda: base.hears("robot") is None, "the robot's departure", 5)
