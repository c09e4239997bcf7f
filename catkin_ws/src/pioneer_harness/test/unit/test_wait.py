"""Waiting returns as soon as possible; a timeout names what was awaited."""

import threading
import time

import pytest

from pioneer_harness.error import WaitError
from pioneer_harness.wait import wait_until


def test_returns_the_first_true_value():
    values = iter([0, None, "", "there"])
    assert wait_until(lambda: next(values), "a value", 5.0) == "there"


def test_failure_names_what_was_awaited_and_the_last_value():
    with pytest.raises(
        WaitError, match=r"three robots: not within 0.05 s; the last value was \[\]"
    ):
        wait_until(list, "three robots", 0.05)


def test_a_condition_is_looked_at_once_even_without_time():
    assert wait_until(lambda: True, "now", 0.0)


def test_a_notification_ends_the_wait_without_polling():
    ready, looks, notified = [], [], threading.Condition()

    def announce():
        with notified:
            ready.append(1)
            notified.notify_all()

    timer = threading.Timer(0.2, announce)

    def condition():
        if not looks:
            timer.start()  # not earlier: the first check may be late
        looks.append(time.monotonic())
        return ready

    assert wait_until(condition, "the announcement", 5.0, notified) == [1]
    timer.join()
    assert len(looks) == 2


def test_errors_of_the_condition_pass_through():
    with pytest.raises(ZeroDivisionError):
        wait_until(lambda: 1 / 0, "never", 1.0)
