"""Hosts whose clients fail to prove the hub's password."""

from rocon_hub.guess import FIRST_DELAY, LONGEST_DELAY, MAX_HOSTS, FailingHosts, host_of


def test_each_failure_doubles_the_pause_up_to_a_limit() -> None:
    hosts = FailingHosts()
    pauses = []
    for _ in range(40):
        hosts.fail("192.168.2.9", 100.0)
        host = hosts.get("192.168.2.9")
        assert host
        pauses.append(host.ready_at - 100.0)
    assert round(pauses[0], 6) == FIRST_DELAY
    assert round(pauses[1], 6) == 2 * FIRST_DELAY
    assert pauses == sorted(pauses)
    assert pauses[-1] == LONGEST_DELAY


def test_the_table_is_bounded_and_forgets_what_failed_longest_ago() -> None:
    hosts = FailingHosts()
    assert hosts.fail("1.0.0.1", 0.0)
    assert not hosts.fail("1.0.0.1", 0.0)
    for number in range(MAX_HOSTS + 5):
        hosts.fail(f"10.0.{number // 250}.{number % 250}", 0.0)
    assert len(hosts._hosts) == MAX_HOSTS
    assert hosts.get("1.0.0.1") is None


def test_an_ipv6_network_counts_as_one_host() -> None:
    assert host_of("2001:db8::1") == host_of("2001:db8::ffff:1")
    assert host_of("2001:db8::1") != host_of("2001:db8:0:1::1")
    assert host_of("fe80::1%eth0") == host_of("fe80::2")
    assert host_of("10.0.0.1") != host_of("10.0.0.2")
    assert host_of("") == ""
