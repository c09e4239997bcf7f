"""The fleet page of the running fleet: its address, its access control, and the robots on it."""

import json
import re
import urllib.error
import urllib.request
from collections.abc import Iterator
from http import HTTPStatus

import pytest
import websocket
from tested_fleet import PATIENCE, Fleet

from containers.engine import WEB, output
from pioneer_harness.error import WaitError
from pioneer_harness.wait import wait_until


@pytest.fixture(scope="module")
def page(driving: Fleet) -> Iterator[tuple[str, str]]:
    """Yields the address that `up --web` prints, and the token in it."""
    said = driving.pioneer("up", "--web")
    found = re.search(r"^Fleet page, once it is up: (http://\S+)/#(\S+)$", said, re.M)
    assert found, said
    yield found[1], found[2]
    labels = (
        f"label=com.docker.compose.project={driving.project}",
        f"label=com.docker.compose.service={WEB}",
    )
    # The killed page leaves rules and publishers behind; tests of `up` that run later must not wait for them.
    output(
        "docker",
        "rm",
        "-f",
        output("docker", "ps", "-aq", "--filter", labels[0], "--filter", labels[1]).strip(),
    )


def test_the_page_shows_five_robots_and_what_their_computers_do(page: tuple[str, str]) -> None:
    url, token = page
    with urllib.request.urlopen(
        urllib.request.Request(f"{url}/login", token.encode()), timeout=PATIENCE
    ) as answer:
        cookie = answer.headers["Set-Cookie"].partition(";")[0]
    live = websocket.create_connection(
        url.replace("http", "ws") + "/live", timeout=PATIENCE, cookie=cookie
    )
    state: dict[str, object] = {}

    def shown() -> bool:
        state.update(json.loads(live.recv()))
        rows = [state.get(f"pioneer{number}.row") for number in range(1, 6)]
        # An age of odometry may be 0.0.
        return all(
            isinstance(row, dict) and row["odom"] is not None and row["load"] and not row["fault"]
            for row in rows
        )

    try:
        wait_until(shown, "five robots without a fault, and the load of their computers", PATIENCE)
    except WaitError as error:
        raise AssertionError(
            [state.get(f"pioneer{number}.row") for number in range(1, 6)]
        ) from error
    finally:
        live.close()


def test_without_the_token_there_is_nothing(page: tuple[str, str]) -> None:
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(page[0], timeout=PATIENCE)
    with refused.value as answer:
        assert answer.code == HTTPStatus.UNAUTHORIZED
