"""A node registers at the master and unregisters."""

import contextlib
import logging
import random
import threading
import xmlrpc.client
from collections.abc import Callable, Iterator
from socketserver import ThreadingMixIn
from types import SimpleNamespace
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from std_msgs.msg import String
from std_srvs.srv import Empty

from tcpros import node
from tcpros.client import ClientError, Connection
from tcpros.frame import MAX_MESSAGE
from tcpros.node import Node
from tcpros.node_context import NodeContext
from tcpros.reactor import BUFFER_SIZE, Reactor
from tcpros.topic_source import Sender, TopicSource
from tcpros.xmlrpc_client import NoAnswer

SLOW = 0.5
"""How long the master takes to register [s], unless the node unregisters meanwhile."""
HANGS = 20.0


class SlowMaster(ThreadingMixIn, SimpleXMLRPCServer):
    """Executes calls in parallel, like rosmaster, and registers slowly; records calls in the order of execution."""

    daemon_threads = True

    def __init__(self, slow: float = SLOW) -> None:
        super().__init__(("127.0.0.1", 0), logRequests=False)
        self.executed: list[str] = []
        self._slow = slow
        self._unregisters = threading.Event()
        self.register_instance(self)

    def _dispatch(self, method: str, _arguments: object) -> tuple[int, str, list[str]]:
        if method.startswith("unregister"):
            self._unregisters.set()
        else:
            self._unregisters.wait(self._slow)
        self.executed.append(method)
        return 1, "", []


@contextlib.contextmanager
def serving(master: SimpleXMLRPCServer) -> Iterator[NodeContext]:
    """Runs a master; yields a context for its nodes."""
    with master:
        thread = threading.Thread(target=master.serve_forever)
        thread.start()
        logger = logging.getLogger("node")
        uri = f"http://127.0.0.1:{master.server_address[1]}"
        yield NodeContext(Reactor(logger), uri, "127.0.0.1", "127.0.0.1", logger)
        master.shutdown()
        thread.join()


@pytest.fixture
def master() -> SlowMaster:
    return SlowMaster()


@pytest.fixture
def context(master: SlowMaster) -> Iterator[NodeContext]:
    with serving(master) as made:
        yield made


@pytest.fixture
def quick() -> Iterator[NodeContext]:
    """A context whose master answers at once, and knows no publishers."""
    with serving(SlowMaster(slow=0.0)) as made:
        yield made


def connect(receiver: Node, source: TopicSource, sender: Node) -> None:
    """Connects a subscription to a publisher, in place of the master."""
    receiver.when_registered(lambda: source.update([sender.uri]))


def run_for(context: NodeContext) -> None:
    """Runs the event loop until it is stopped; fails after `HANGS`."""
    overdue = []
    context.reactor.call_later(HANGS, lambda: (overdue.append(True), context.reactor.stop()))
    context.reactor.run()
    assert not overdue


def test_a_node_that_ends_while_it_registers_does_not_stay_registered(
    master: SlowMaster, context: NodeContext
) -> None:
    node = Node(context, "/one", lambda _: None)
    node.publish("/words", String)
    node.close(context.reactor.stop)
    run_for(context)
    assert master.executed == ["registerPublisher", "unregisterPublisher"]


def test_a_node_that_ends_while_it_registers_again_does_not_stay_registered(
    master: SlowMaster, context: NodeContext
) -> None:
    node = Node(context, "/one", lambda _: None)
    node.publish("/words", String)

    def end() -> None:
        node.register_again()
        node.close(context.reactor.stop)

    node.when_registered(end)
    run_for(context)
    assert master.executed == ["registerPublisher", "registerPublisher", "unregisterPublisher"]


def test_a_topic_that_is_withdrawn_while_it_registers_again_does_not_stay_registered(
    master: SlowMaster, context: NodeContext
) -> None:
    node = Node(context, "/one", lambda _: None)
    node.publish("/words", String)

    def withdraw() -> None:
        node.register_again()
        node.unpublish("/words")
        node.when_registered(lambda: node.close(context.reactor.stop))

    node.when_registered(withdraw)
    run_for(context)
    assert master.executed == ["registerPublisher", "registerPublisher", "unregisterPublisher"]


def test_a_subscription_that_ends_while_it_registers_does_not_stay(
    master: SlowMaster, context: NodeContext
) -> None:
    node = Node(context, "/one", lambda _: None)
    node.unsubscribe(node.subscribe("/words", String, lambda *_: None))
    node.when_registered(lambda: node.close(context.reactor.stop))
    run_for(context)
    assert master.executed == ["registerSubscriber", "unregisterSubscriber"]


def test_a_node_that_ends_with_a_subscription_that_just_ended_leaves_none(
    master: SlowMaster, context: NodeContext
) -> None:
    node = Node(context, "/one", lambda _: None)
    node.unsubscribe(node.subscribe("/words", String, lambda *_: None))
    node.close(context.reactor.stop)
    run_for(context)
    assert master.executed == ["registerSubscriber", "unregisterSubscriber"]


class HeldMaster:
    """Holds the answers of all calls until they are released; records the calls in the order in which they come."""

    def __init__(self) -> None:
        self.called: list[str] = []
        self._held: list[tuple[Callable[[object], object], Callable[[str], object]]] = []

    def call(
        self,
        method: str,
        _arguments: tuple[object, ...],
        done: Callable[[object], object],
        failed: Callable[[str], object],
    ) -> None:
        """Called by the node."""
        self.called.append(method)
        self._held.append((done, failed))

    def answer(self, value: object = ()) -> list[str]:
        """Answers all calls; returns those that were made since the last call of this."""
        called, self.called = self.called, []
        held, self._held = self._held, []
        for done, _ in held:
            done(value)
        return called

    def give_no_answer(self) -> None:
        """Lets all calls fail as if the master hung."""
        self._fail(NoAnswer("it hangs"))

    def refuse(self) -> None:
        """Refuses all calls."""
        self._fail("it refuses")

    def _fail(self, reason: str) -> None:
        held, self._held = self._held, []
        for _, failed in held:
            failed(reason)


@pytest.fixture
def held(quick: NodeContext) -> HeldMaster:
    """The master of the context."""
    quick.master = HeldMaster()  # type: ignore[assignment]
    return quick.master  # type: ignore[return-value]


class Use:
    """A node's use of a topic as a publisher or a subscriber."""

    def __init__(self, node: Node, role: str) -> None:
        self._node, self._role = node, role
        self._source: TopicSource | None = None

    def begin(self) -> None:
        """Takes the topic up."""
        if self._role == "Publisher":
            self._node.publish("/words", String)
        else:
            self._source = self._node.subscribe("/words", String, lambda *_: None)

    def end(self) -> None:
        """Gives the topic up."""
        if self._source is None:
            self._node.unpublish("/words")
        else:
            self._node.unsubscribe(self._source)


ROLES = pytest.mark.parametrize("role", ["Publisher", "Subscriber"])


@ROLES
def test_a_topic_taken_up_again_is_registered_once_its_end_is_confirmed(
    quick: NodeContext, held: HeldMaster, role: str
) -> None:
    """The master may execute both calls in the other order: then the topic was in use and not registered."""
    node = Node(quick, "/one", lambda _: None)
    use = Use(node, role)
    use.begin()
    assert held.answer() == [f"register{role}"]
    use.end()
    use.begin()
    registered = list[str]()
    node.when_registered(lambda: registered.append("again"))
    assert held.answer() == [f"unregister{role}"]
    assert registered == []
    assert held.answer() == [f"register{role}"]
    assert registered == ["again"]
    node.close(lambda: None)
    held.answer()


@ROLES
def test_a_topic_taken_up_again_before_its_end_is_called_is_not_unregistered(
    quick: NodeContext, held: HeldMaster, role: str
) -> None:
    node = Node(quick, "/one", lambda _: None)
    use = Use(node, role)
    use.begin()
    use.end()
    use.begin()
    assert held.answer() == [f"register{role}"] * 2
    assert held.answer() == []
    node.close(lambda: None)
    held.answer()


@ROLES
def test_a_topic_that_has_just_ended_is_unregistered_by_a_node_that_ends(
    quick: NodeContext, held: HeldMaster, role: str
) -> None:
    node = Node(quick, "/one", lambda _: None)
    use = Use(node, role)
    use.begin()
    use.end()
    node.close(lambda: None)
    assert held.answer() == [f"register{role}"]
    assert held.answer() == [f"unregister{role}"]


def test_a_node_that_ends_unregisters_all_that_it_has_and_waits_for_every_answer(
    quick: NodeContext, held: HeldMaster
) -> None:
    node = Node(quick, "/one", lambda _: None)
    node.publish("/words", String)
    node.subscribe("/answers", String, lambda *_: None)
    node.serve("/ask", Empty, lambda _: b"")
    node.watch("/rate", lambda _: None)
    held.answer()
    ended = list[str]()
    node.register_again()
    node.close(lambda: ended.append("ended"))
    kinds = {"registerPublisher", "registerSubscriber", "registerService", "subscribeParam"}
    assert set(held.answer()) == kinds
    assert ended == []
    ends = {"unregisterPublisher", "unregisterSubscriber", "unregisterService", "unsubscribeParam"}
    assert set(held.answer()) == ends
    assert ended == ["ended"]


def test_a_restarted_masters_answer_older_than_a_notification_replaces_nothing(
    quick: NodeContext, held: HeldMaster, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = Node(quick, "/one", lambda _: None)
    source = node.subscribe("/words", String, lambda *_: None)
    values = list[object]()
    node.watch("/rate", values.append)
    held.answer()
    updates = list[object]()
    monkeypatch.setattr(source, "update", updates.append)
    values.clear()
    node.register_again()
    source.notify(["http://127.0.0.1:9/"])
    node._watched["/rate"](7)
    held.answer()
    assert updates == [["http://127.0.0.1:9/"]]
    assert values == [7]
    node.register_again()
    held.answer([])
    assert updates[1:] == [[]]
    node.close(lambda: None)
    held.answer()


def until(context: NodeContext, condition: Callable[[], bool]) -> None:
    """Runs the event loop until a condition holds."""

    def look() -> None:
        if condition():
            context.reactor.stop()
        else:
            context.reactor.call_later(0.01, look)

    look()
    run_for(context)


def test_what_does_not_reach_a_restarted_master_is_repeated(
    quick: NodeContext, held: HeldMaster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once the master knew some registrations, nobody repeated the others, and their topics were lost."""
    monkeypatch.setattr("tcpros.node.ASK_AGAIN", 0.01)
    node = Node(quick, "/one", lambda _: None)
    node.publish("/words", String)
    node.subscribe("/numbers", String, lambda *_: None)
    calls = held.answer()
    node.register_again()
    held.called.clear()
    held.give_no_answer()
    until(quick, lambda: len(held.called) == len(calls))
    assert sorted(held.answer()) == sorted(calls)
    node.close(lambda: None)
    held.answer()


@ROLES
@pytest.mark.parametrize("ends_first", [False, True])
def test_an_unregistration_without_an_answer_is_made_by_the_node_that_ends(
    quick: NodeContext, held: HeldMaster, role: str, ends_first: bool
) -> None:
    """Its retry was left out because the node ended, and the dead node stayed registered."""
    node = Node(quick, "/one", lambda _: None)
    use = Use(node, role)
    use.begin()
    held.answer()
    use.end()
    if ends_first:
        node.close(lambda: None)
    held.give_no_answer()
    if not ends_first:
        node.close(lambda: None)
    assert held.answer() == [f"unregister{role}"] * 2


def test_an_answer_to_a_repeated_call_is_newer_than_a_notification_before_it(
    quick: NodeContext, held: HeldMaster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last update of the old master came before the call that reached the new one, whose answer was dropped."""
    monkeypatch.setattr("tcpros.node.ASK_AGAIN", 0.01)
    node = Node(quick, "/one", lambda _: None)
    source = node.subscribe("/words", String, lambda *_: None)
    held.answer()
    updates = list[object]()
    monkeypatch.setattr(source, "update", updates.append)
    node.register_again()
    source.notify(["http://127.0.0.1:9/"])
    held.called.clear()
    held.give_no_answer()
    until(quick, lambda: bool(held.called))
    held.answer(["http://127.0.0.1:8/"])
    assert updates == [["http://127.0.0.1:9/"], ["http://127.0.0.1:8/"]]
    node.close(lambda: None)
    held.answer()


def test_repetitions_at_a_master_that_does_not_answer_do_not_add_up(
    quick: NodeContext, held: HeldMaster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tcpros.node.ASK_AGAIN", 0.01)
    node = Node(quick, "/one", lambda _: None)
    node.publish("/words", String)
    held.answer()
    for _ in range(5):
        node.register_again()
    held.called.clear()
    held.give_no_answer()
    until(quick, lambda: bool(held.called))
    assert held.answer() == ["registerPublisher"]
    node.close(lambda: None)
    held.answer()


def test_a_registration_that_a_restarted_master_refuses_does_not_end_the_node(
    quick: NodeContext, held: HeldMaster
) -> None:
    ended = list[str]()
    node = Node(quick, "/one", ended.append)
    node.publish("/words", String)
    held.answer()
    node.register_again()
    registered = list[str]()
    node.when_registered(lambda: registered.append("again"))
    held.refuse()
    assert ended == []
    assert registered == ["again"]
    node.close(lambda: None)
    held.answer()


def test_each_time_that_the_master_hangs_is_logged_once(
    quick: NodeContext, held: HeldMaster, caplog: pytest.LogCaptureFixture
) -> None:
    node = Node(quick, "/one", lambda _: None)
    for outage in (1, 2):
        node.publish(f"/first{outage}", String)
        node.publish(f"/second{outage}", String)
        held.give_no_answer()
        assert caplog.text.count("the master does not answer") == outage
        node.publish(f"/third{outage}", String)
        held.answer()
    node.close(lambda: None)
    held.answer()


def test_a_withdrawn_topic_is_unregistered_and_its_subscribers_are_disconnected(
    master: SlowMaster, context: NodeContext
) -> None:
    sender = Node(context, "/sender", lambda _: None)
    receiver = Node(context, "/receiver", lambda _: None)
    publication = sender.publish("/words", String)
    connect(receiver, receiver.subscribe("/words", String, lambda *_: None), sender)

    def withdraw_once_connected() -> None:
        if not publication.subscribers:
            context.reactor.call_later(0.01, withdraw_once_connected)
            return
        sender.unpublish("/words")
        receiver.close(lambda: None)
        sender.when_registered(lambda: sender.close(context.reactor.stop))

    withdraw_once_connected()
    run_for(context)
    assert not publication.subscribers
    assert len(publication._fanout) == 0
    assert master.executed.count("unregisterPublisher") == 1


def test_a_topic_advertised_twice_stays_until_it_is_withdrawn_twice(
    master: SlowMaster, context: NodeContext
) -> None:
    node = Node(context, "/sender", lambda _: None)
    first = node.publish("/words", String)
    assert node.publish("/words", String) is first
    node.unpublish("/words")
    assert node.publish("/words", String) is first
    node.unpublish("/words")
    node.unpublish("/words")
    assert node.publish("/words", String) is not first
    node.close(context.reactor.stop)
    run_for(context)
    assert master.executed.count("unregisterPublisher") == 1


@pytest.mark.parametrize("size", [10, BUFFER_SIZE // 4, BUFFER_SIZE, 5_000_000])
def test_messages_of_any_size_arrive_whole_and_in_order(quick: NodeContext, size: int) -> None:
    source = random.Random(size)
    sent = [source.randbytes(length) for length in (3, size, 5, size, size + 1, 0)]
    received = []
    sender = Node(quick, "/sender", lambda _: None)
    receiver = Node(quick, "/receiver", lambda _: None)
    publication = sender.publish("/words", String)

    def take(message: memoryview, _sender: Sender) -> None:
        received.append(bytes(message))
        if len(received) == len(sent):
            receiver.close(lambda: sender.close(quick.reactor.stop))

    connect(receiver, receiver.subscribe("/words", String, take), sender)

    def send_once_connected() -> None:
        if not publication.subscribers:
            quick.reactor.call_later(0.01, send_once_connected)
            return
        for connection in publication.subscribers:
            connection.backlog.bound(len(sent), sum(map(len, sent)) + 1000, drops_first=True)
        for message in sent:
            publication.send(len(message).to_bytes(4, "little") + message)

    send_once_connected()
    run_for(quick)
    assert received == sent


@pytest.mark.parametrize("size", [10, BUFFER_SIZE // 2, 300_000, 5_000_000])
def test_a_latched_message_of_any_size_arrives_with_the_first_connection(
    quick: NodeContext, size: int
) -> None:
    message = random.Random(size).randbytes(size)
    received = []
    sender = Node(quick, "/sender", lambda _: None)
    receiver = Node(quick, "/receiver", lambda _: None)
    publication = sender.publish("/words", String, latching=True)
    publication.send(len(message).to_bytes(4, "little") + message)

    def take(data: memoryview, _sender: Sender) -> None:
        received.append((bytes(data), len(publication.subscribers)))
        receiver.close(lambda: sender.close(quick.reactor.stop))

    connect(receiver, receiver.subscribe("/words", String, take), sender)
    run_for(quick)
    assert received == [(message, 1)]


class LateMaster(ThreadingMixIn, SimpleXMLRPCServer):
    """Notifies each new subscriber before it answers, and then answers with the state from before."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), logRequests=False)
        self.calls: list[str] = []
        self.new: object = None
        self.register_instance(self)

    def _dispatch(self, method: str, arguments: tuple[str, ...]) -> tuple[int, str, object]:
        self.calls.append(method)
        if method not in ("registerSubscriber", "subscribeParam"):
            return 1, "", 0
        if self.calls.count(method) > 1:
            return 1, "", self.new
        if method == "registerSubscriber":
            topic, _type, uri = arguments[1:]
            with xmlrpc.client.ServerProxy(uri) as slave:
                slave.publisherUpdate("/master", topic, self.new)
            return 1, "", []
        uri, parameter = arguments[1:]
        with xmlrpc.client.ServerProxy(uri) as slave:
            slave.paramUpdate("/master", parameter, self.new)
        return 1, "", {}


@pytest.fixture
def late() -> Iterator[tuple[LateMaster, NodeContext]]:
    master = LateMaster()
    with serving(master) as context:
        yield master, context


def test_an_answer_older_than_a_notification_does_not_replace_the_publishers(
    late: tuple[LateMaster, NodeContext],
) -> None:
    master, context = late
    sender = Node(context, "/sender", lambda _: None)
    receiver = Node(context, "/receiver", lambda _: None)
    master.new = [sender.uri]
    source = receiver.subscribe("/words", String, lambda *_: None)
    found = []

    def end() -> None:
        found.extend(source._publishers)
        receiver.close(lambda: sender.close(context.reactor.stop))

    receiver.when_registered(end)
    run_for(context)
    assert found == [sender.uri]
    assert master.calls.count("registerSubscriber") == 2


def test_an_answer_older_than_a_notification_does_not_replace_a_parameter(
    late: tuple[LateMaster, NodeContext],
) -> None:
    master, context = late
    node = Node(context, "/one", lambda _: None)
    master.new = 7
    values = []
    node.watch("/speed", values.append)
    node.when_registered(lambda: node.close(context.reactor.stop))
    run_for(context)
    assert values == [7, 7]


def test_all_watchers_of_a_parameter_get_its_values_also_from_a_restarted_master(
    late: tuple[LateMaster, NodeContext],
) -> None:
    master, context = late
    node = Node(context, "/one", lambda _: None)
    master.new = 7
    first, second = [], []
    node.watch("/speed", first.append)
    node.watch("/speed", second.append)

    def restarted() -> None:
        master.new = 8
        node.register_again()
        wait_for_both()

    def wait_for_both() -> None:
        if first[-1] == second[-1] == 8:
            node.close(context.reactor.stop)
        else:
            context.reactor.call_later(0.01, wait_for_both)

    node.when_registered(restarted)
    run_for(context)
    assert first[-1] == second[-1] == 8


def test_a_subscription_that_has_ended_opens_no_connection(
    late: tuple[LateMaster, NodeContext],
) -> None:
    """Its registration may be answered, with publishers, after its end."""
    master, context = late
    sender = Node(context, "/sender", lambda _: None)
    receiver = Node(context, "/receiver", lambda _: None)
    master.new = [sender.uri]
    source = receiver.subscribe("/words", String, lambda *_: None)
    receiver.unsubscribe(source)
    receiver.when_registered(lambda: receiver.close(lambda: sender.close(context.reactor.stop)))
    run_for(context)
    assert not source._publishers


def test_two_subscriptions_of_a_topic_get_all_messages_and_end_by_themselves(
    quick: NodeContext,
) -> None:
    sender = Node(quick, "/sender", lambda _: None)
    receiver = Node(quick, "/receiver", lambda _: None)
    publication = sender.publish("/words", String, latching=True)
    publication.send(b"\x01\0\0\0a")
    first, second = [], []
    sources = [
        receiver.subscribe("/words", String, lambda data, _: first.append(bytes(data))),
        receiver.subscribe("/words", String, lambda data, _: second.append(bytes(data))),
    ]

    def notify() -> None:
        with xmlrpc.client.ServerProxy(receiver.uri) as slave:
            slave.publisherUpdate("/master", "/words", [sender.uri])

    def send_once_both_have_it() -> None:
        if first == second == [b"a"]:
            receiver.unsubscribe(sources[1])
            publication.send(b"\x01\0\0\0b")
        if first == [b"a", b"b"]:
            receiver.close(lambda: sender.close(quick.reactor.stop))
        else:
            quick.reactor.call_later(0.01, send_once_both_have_it)

    # Once the registrations of the test's master, which knows no publishers, are answered.
    receiver.when_registered(threading.Thread(target=notify).start)
    send_once_both_have_it()
    run_for(quick)
    assert (first, second) == ([b"a", b"b"], [b"a"])


def client_thread(context: NodeContext, work: Callable[[], None]) -> None:
    """Runs the event loop while a thread does a blocking client's work."""
    errors = []

    def run() -> None:
        try:
            work()
        except (OSError, AssertionError, pytest.fail.Exception) as error:
            errors.append(error)
        context.reactor.call(context.reactor.stop)

    thread = threading.Thread(target=run)
    thread.start()
    run_for(context)
    thread.join()
    assert not errors


@pytest.mark.parametrize("may_wait", [False, True])
def test_requests_and_responses_of_any_size_are_served_in_order(
    quick: NodeContext, may_wait: bool
) -> None:
    source = random.Random(7)
    sizes = [0, 3, 65_536, 65_537, 131_072, 262_140, 262_144, 300_000, 4_000_000, 5]
    requests = [source.randbytes(size) for size in sizes]

    def answer(request: bytes) -> bytes:
        return len(request).to_bytes(4, "little") + request[::-1]

    node = Node(quick, "/server", lambda _: None)
    node.serve("/reverse", Empty, answer, may_wait)
    address = ("127.0.0.1", int(node.uri.rsplit(":", 1)[1].rstrip("/")))

    def work() -> None:
        fields = {"service": "/reverse", "callerid": "/client", "md5sum": "*", "persistent": "1"}
        with Connection(*address, fields) as connection:
            # Pipelined: the next request arrives together with the end of the one before.
            data = b"".join(len(one).to_bytes(4, "little") + one for one in requests)
            writer = threading.Thread(target=connection._socket.sendall, args=(data,))
            writer.start()
            responses = []
            for _ in requests:
                assert connection._read(1) == b"\x01"
                responses.append(connection.read_frame())
            writer.join()
        assert responses == [one[::-1] for one in requests]

    client_thread(quick, work)


def test_an_api_call_longer_than_the_loops_buffer_is_answered(quick: NodeContext) -> None:
    """Masters list all publishers of a topic in one call, and send whole parameter trees."""
    node = Node(quick, "/one", lambda _: None)
    values = []
    node.watch("/tree", values.append)
    tree = {f"key{number}": "x" * 1000 for number in range(500)}
    registered = threading.Event()
    node.when_registered(registered.set)

    def work() -> None:
        # The test's master does not know the tree: its answer, asked for again after an early update, would come last.
        assert registered.wait(HANGS), "the master has not answered"
        with xmlrpc.client.ServerProxy(node.uri) as slave:
            for _ in range(2):
                slave.paramUpdate("/master", "/tree", tree)

    client_thread(quick, work)
    assert values[-2:] == [tree, tree]


def test_a_request_longer_than_allowed_closes_the_connection(quick: NodeContext) -> None:
    node = Node(quick, "/server", lambda _: None)
    node.serve("/reverse", Empty, lambda _: b"\0\0\0\0")
    address = ("127.0.0.1", int(node.uri.rsplit(":", 1)[1].rstrip("/")))

    def work() -> None:
        fields = {"service": "/reverse", "callerid": "/client", "md5sum": "*"}
        with Connection(*address, fields) as connection:
            connection._socket.sendall((MAX_MESSAGE + 1).to_bytes(4, "little"))
            with pytest.raises(ConnectionError):
                connection._read(1)

    client_thread(quick, work)


def test_a_request_that_gets_no_thread_is_answered_with_the_reason(
    quick: NodeContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    server = Node(quick, "/server", lambda _: None)
    server.serve("/reverse", Empty, lambda _: b"\0\0\0\0", may_wait=True)
    address = ("127.0.0.1", int(server.uri.rsplit(":", 1)[1].rstrip("/")))

    class NoThread(threading.Thread):
        start = refuse

    def work() -> None:
        fields = {"service": "/reverse", "callerid": "/client", "md5sum": "*", "persistent": "1"}
        with Connection(*address, fields) as connection:
            for _ in range(2):
                with pytest.raises(ClientError, match="not processed: can't start new thread"):
                    connection.call_raw(b"")
            monkeypatch.undo()
            assert connection.call_raw(b"") == b""

    monkeypatch.setattr(node, "threading", SimpleNamespace(Thread=NoThread))
    client_thread(quick, work)


def test_a_subscribers_name_of_any_bytes_leaves_the_nodes_state_readable(
    quick: NodeContext,
) -> None:
    node = Node(quick, "/sender", lambda _: None)
    node.publish("/words", String)
    address = ("127.0.0.1", int(node.uri.rsplit(":", 1)[1].rstrip("/")))

    def work() -> None:
        fields = {"topic": "/words", "callerid": "\udcff\x01\n", "md5sum": "*", "type": "*"}
        with Connection(*address, fields), xmlrpc.client.ServerProxy(node.uri) as slave:
            _, _, rows = slave.getBusInfo("/tester")
        assert [row[1] for row in rows] == ["\ufffd\ufffd\ufffd"]

    client_thread(quick, work)


def nested(depth: int) -> object:
    value: object = 1
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize("value", [2**40, "\udcff", object(), nested(5000)])
def test_a_call_with_a_value_that_xml_cannot_carry_fails(quick: NodeContext, value: object) -> None:
    reasons = []

    def failed(reason: str) -> None:
        reasons.append(reason)
        quick.reactor.stop()

    quick.master.call("setParam", ("/one", "/speed", value), lambda _: None, failed)
    assert not reasons, "callbacks are deferred"
    run_for(quick)
    assert "setParam cannot be called with these values" in reasons[0]


def test_a_message_longer_than_allowed_ends_the_connection_and_pauses_grow(
    quick: NodeContext, caplog: pytest.LogCaptureFixture
) -> None:
    sender = Node(quick, "/sender", lambda _: None)
    receiver = Node(quick, "/receiver", lambda _: None)
    publication = sender.publish("/words", String)
    connect(receiver, receiver.subscribe("/words", String, lambda *_: None), sender)
    refused = []

    def send() -> None:
        for connection in tuple(publication.subscribers):
            if connection not in refused:
                refused.append(connection)
                connection.send((MAX_MESSAGE + 1).to_bytes(4, "little"))

    def repeat() -> None:
        send()
        if len(refused) < 3:
            quick.reactor.call_later(0.005, repeat)
        else:
            receiver.close(lambda: sender.close(quick.reactor.stop))

    repeat()
    run_for(quick)
    lines = [record.getMessage() for record in caplog.records if "gets no" in record.getMessage()]
    assert len(lines) == 1
    assert f"a message of {MAX_MESSAGE + 1} bytes, above {MAX_MESSAGE}" in lines[0]
