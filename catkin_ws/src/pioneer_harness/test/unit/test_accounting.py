"""CPU time is counted once, even if several sources report it."""

from pioneer_harness.accounting import Account
from pioneer_harness.proc import ProcessState


def state(pid, parent=1, cpu=0.0, waited=0.0, rss=100, alive=True, started=7):
    return ProcessState(pid, parent, pid, alive, started, cpu, waited, rss)


def account_of(*samples, kinds):
    account = Account(lambda argv: argv[0])
    for sample in samples:
        account.add(sample, lambda pid: (kinds[pid],))
    return account.usage()


def test_the_last_sample_of_each_process_counts():
    usage = account_of([state(5, cpu=1.0)], [state(5, cpu=3.0)], kinds={5: "amcl"})
    assert usage["amcl"].cpu == 3.0
    assert usage["amcl"].processes == 1


def test_an_ended_child_is_not_counted_again_in_its_parents_waited_time():
    kinds = {5: "roslaunch", 6: "amcl"}
    usage = account_of([state(5), state(6, parent=5, cpu=2.0)], [state(5, waited=2.0)], kinds=kinds)
    assert usage["amcl"].cpu == 2.0
    assert usage["other"].cpu == 0.0


def test_children_never_sampled_count_as_other():
    usage = account_of([state(5)], [state(5, waited=1.5)], kinds={5: "roslaunch"})
    assert usage["other"].cpu == 1.5


def test_peak_memory_is_the_largest_sum_of_one_sample():
    kinds = {5: "amcl", 6: "amcl"}
    usage = account_of([state(5, rss=10), state(6, rss=20)], [state(5, rss=25)], kinds=kinds)
    assert usage["amcl"].rss == 30


def test_a_pid_used_again_is_another_process():
    usage = account_of([state(5, cpu=1.0)], [state(5, cpu=2.0, started=9)], kinds={5: "amcl"})
    assert usage["amcl"].cpu == 3.0
    assert usage["amcl"].processes == 2


def test_a_zombies_last_times_count_under_its_old_kind():
    usage = account_of([state(5, cpu=1.0)], [state(5, cpu=1.2, alive=False)], kinds={5: "amcl"})
    assert usage["amcl"].cpu == 1.2
