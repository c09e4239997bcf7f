"""Which places a robot may hold by now whose reports are lost."""

from pioneer_traffic.config import CoordinatorConfig
from pioneer_traffic.foresight import Foresight
from pioneer_traffic.report import Plan, PlanId, Report, Wait
from pioneer_traffic.roadmap import Roadmap

ROW = Roadmap(
    [(float(place), 0.0) for place in range(20)],
    [[other for other in (place - 1, place + 1) if 0 <= other < 20] for place in range(20)],
)
"""Twenty places, 1 m apart."""
CONFIG = CoordinatorConfig(horizon=3, lease=2.0, speed=1.0)
PATH = tuple(range(20))


def foresight() -> Foresight:
    return Foresight("own", ROW, CONFIG)


def plan(number: int, *waits: Wait, path: tuple[int, ...] = PATH) -> Plan:
    return Plan(PlanId(number, "own"), {"other": path[:1]}, {"other": path, "own": (0,)}, {}, waits)


def report(ready: int, adopted: int, reached: int = 0) -> Report:
    place = max(0, reached)
    return Report(
        "other",
        ROW.signature,
        ROW.places[place],
        (place,),
        ready=PlanId(ready, "own" if ready else ""),
        adopted=PlanId(adopted, "own" if adopted else ""),
        reached=reached,
    )


def test_it_may_have_come_as_far_as_it_drives_until_it_notices_and_holds_the_places_ahead() -> None:
    ahead = foresight()
    ahead.learn(plan(1), 0.0)
    # 1 m/s for two leases, and three places more.
    assert ahead.may_hold(report(1, 1, reached=2), 5.0) == set(range(2, 2 + 4 + 3 + 1))


def test_it_takes_no_place_for_which_it_waits_for_this_robot() -> None:
    ahead = foresight()
    ahead.learn(plan(1, Wait("other", 3, "own", 1), Wait("other", 2, "third", 1)), 0.0)
    assert ahead.may_hold(report(1, 1), 5.0) == {0, 1, 2}
    own = Report("own", ROW.signature, (0.0, 0.0), (0,), adopted=PlanId(1, "own"), reached=1)
    ahead.note_own(own)
    assert ahead.may_hold(report(1, 1), 5.0) > {0, 1, 2, 3}


def test_it_takes_no_place_by_a_plan_if_it_knows_a_newer_one() -> None:
    ahead = foresight()
    ahead.learn(plan(1), 0.0)
    ahead.learn(Plan(PlanId(2, "own"), {"own": (0,)}, {"own": (0,)}), 1.0)
    assert ahead.may_hold(report(2, 1), 5.0) == {0}


def test_it_may_have_adopted_a_plan_that_it_did_not_know() -> None:
    ahead = foresight()
    ahead.learn(plan(1), 0.0)
    ahead.learn(plan(2, path=PATH[::-1]), 5.0)
    assert 19 in ahead.may_hold(report(1, 1), 5.0)


def test_of_a_robot_that_was_started_again_plans_of_before_do_not_count() -> None:
    """It knows no plan. All plans with its name kept their places from the others, for five minutes."""
    ahead = foresight()
    ahead.learn(plan(1), 0.0)
    ahead.learn(plan(2, path=(19, 18)), 1.0)
    ahead.learn(Plan(PlanId(3, "own"), {"own": (0,)}, {"own": (0,)}), 2.0)
    assert ahead.may_hold(report(0, 0), 60.0) == {0}


def test_plans_replaced_before_the_clock_jumped_back_do_not_count_for_ever() -> None:
    """Their times lay ahead of the new clock."""
    ahead = foresight()
    ahead.learn(plan(1), 1000.0)
    ahead.learn(Plan(PlanId(2, "own"), {"own": (0,)}, {"own": (0,)}), 1001.0)
    ahead.restart_clock()
    assert ahead.may_hold(report(0, 0), 3.0) == {0}
