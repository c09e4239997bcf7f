"""A participant in a ROS 2 domain, by Cyclone DDS: topics whose samples are bytes that are encoded already.

Source of the conventions: rmw_dds_common (graph topic, user data), REP 2011 (type hashes).
"""

import logging
import os
from collections.abc import Callable, Mapping
from typing import Any

from cyclonedds._clayer import ddspy_take, ddspy_write
from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import (
    DDSException,
    InstanceState,
    Listener,
    Policy,
    Qos,
    SampleState,
    ViewState,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct, make_idl_struct, types
from cyclonedds.internal import DDS
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from pioneer_ros2 import rule
from pioneer_ros2.matching import ignore_type_descriptions, match_by_name
from pioneer_ros2.message import Converter, MessageTypes
from pioneer_ros2.naming import dds_topic, dds_type, ros2_type

_LOG = logging.getLogger("rosout")
_BASES: dict[str, Any] = {
    "bool": bool,
    "byte": types.uint8,
    "char": types.uint8,
    "octet": types.uint8,
    "string": str,
    **{
        f"{sign}int{bits}": getattr(types, f"{sign}int{bits}")
        for sign in ("", "u")
        for bits in (8, 16, 32, 64)
    },
    "float32": types.float32,
    "float64": types.float64,
}
_NAME, _ARRAY, _SEQUENCE = 2, 3, 4
"""Kinds of fields in rosbags' definitions."""
DURABILITY, RELIABILITY = "durability", "reliability"
"""Policies of which the door can offer or accept another value."""
_POLICIES = {
    2: DURABILITY, 4: "deadline", 5: "latency budget", 6: "ownership", 8: "liveliness", 11: RELIABILITY,
    12: "destination order", 23: "data representation",
}  # fmt: skip
"""Policies by which endpoints may not match, by their numbers in DDS."""
_DEPTH = 10
"""Samples that a writer or reader keeps, as in ROS 2's default profile."""
_LONGEST_WAIT = 0.001
"""A reliable writer waits so long for a reader whose buffers are full, then the sample is dropped [s]."""
_NO_LINGER = (
    "<CycloneDDS><Domain><Internal><WriterLingerDuration>0 s</WriterLingerDuration></Internal>"
    "</Domain></CycloneDDS>"
)
"""A writer that is closed does not wait for readers: one that was killed would keep the node for its lease, 20 s."""
_MOST_TAKEN = 64
_ONLY_FATAL = 1
"""Cyclone's log category that reaches standard error."""
_GRAPH = "ros_discovery_info"
_GRAPH_TYPE = "rmw_dds_common/ParticipantEntitiesInfo"
_ANY_STATE = SampleState.Any | ViewState.Any | InstanceState.Any


class SampleTypes:
    """Cyclone's form of message types."""

    def __init__(self, messages: MessageTypes) -> None:
        self._messages = messages
        self._made: dict[str, type[IdlStruct]] = {}

    def struct(self, type_name: str) -> type[IdlStruct]:
        """Returns the struct of the type ``package/Name``."""
        if type_name not in self._made:
            self._made[type_name] = self.new_struct(type_name)
        return self._made[type_name]

    def new_struct(self, type_name: str) -> type[IdlStruct]:
        """Returns another struct of the type, for one topic."""
        members = {
            name: self._member(definition)
            for name, definition in self._messages.fields(ros2_type(type_name))
        }
        return make_idl_struct(type_name.split("/")[1], dds_type(type_name), members)

    def _member(self, definition: Any) -> Any:
        kind, argument = definition
        if kind == _NAME:
            package, _, name = argument.split("/")
            return self.struct(f"{package}/{name}")
        if kind == _ARRAY:
            return types.array[self._member(argument[0]), argument[1]]
        if kind == _SEQUENCE:
            inner = self._member(argument[0])
            return types.sequence[inner, argument[1]] if argument[1] else types.sequence[inner]
        base, bound = argument
        return types.bounded_str[bound] if bound else _BASES[base]


def configuration(environment: Mapping[str, str]) -> str | None:
    """Returns Cyclone's configuration for ROS 2's variables of discovery; None: Cyclone's own.

    Without ``CYCLONEDDS_URI``, ``ROS_AUTOMATIC_DISCOVERY_RANGE`` and ``ROS_LOCALHOST_ONLY=0``, only this machine is
    reached.
    """
    if environment.get("CYCLONEDDS_URI"):
        return None
    reach = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper()
    if environment.get("ROS_LOCALHOST_ONLY") == "1" or (
        not reach and environment.get("ROS_LOCALHOST_ONLY") != "0"
    ):
        reach = "LOCALHOST"
    peers = [peer for peer in environment.get("ROS_STATIC_PEERS", "").split(";") if peer]
    if reach in ("", "SUBNET", "SYSTEM_DEFAULT") and not peers:
        return None
    general = ""
    if reach == "LOCALHOST":
        peers.append("127.0.0.1")
        general = (
            "<General><AllowMulticast>spdp</AllowMulticast>"
            '<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>'
        )
    elif reach == "OFF":
        peers = []
        general = "<General><AllowMulticast>false</AllowMulticast></General>"
    listed = "".join(f'<Peer address="{peer}"/>' for peer in peers)
    discovery = (
        "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>99</MaxAutoParticipantIndex>"
        f"<Peers>{listed}</Peers></Discovery>"
    )
    return f"<CycloneDDS><Domain>{general}{discovery}</Domain></CycloneDDS>"


def _policies(qos: rule.Qos, converter: Converter) -> Qos:
    """Returns the quality of service that a writer offers."""
    hashed = Policy.Userdata(f"typehash={converter.type_hash};".encode())
    if qos is rule.Qos.LATCHED:
        kept = (Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
    else:
        kept = (
            Policy.Durability.Volatile,
            Policy.History.KeepLast(1 if qos is rule.Qos.SENSOR else _DEPTH),
        )
    return Qos(Policy.Reliability.Reliable(duration(seconds=_LONGEST_WAIT)), *kept, hashed)


def _requested(qos: rule.Qos, converter: Converter) -> Qos:
    """Returns the quality of service that a reader requests."""
    hashed = Policy.Userdata(f"typehash={converter.type_hash};".encode())
    reliability = Policy.Reliability.Reliable(duration(seconds=_LONGEST_WAIT))
    if qos is rule.Qos.SENSOR:
        reliability = Policy.Reliability.BestEffort
    return Qos(reliability, Policy.Durability.Volatile, Policy.History.KeepLast(_DEPTH), hashed)


def _policy(status: Any) -> str:
    """Returns the policy in a status of incompatible quality of service; empty if there was no such endpoint."""
    if not status.total_count:
        return ""
    return _POLICIES.get(status.last_policy_id, f"policy {status.last_policy_id}")


class Writer:
    """Offers one topic in ROS 2."""

    def __init__(
        self, participant: "Participant", name: str, converter: Converter, qos: rule.Qos
    ) -> None:
        self.converter = converter
        self._writer = DataWriter(
            participant.entity,
            participant.topic(name, converter.type_name),
            qos=_policies(qos, converter),
            listener=participant.matching,
        )

    @property
    def guid(self) -> bytes:
        """The writer's identifier in the domain, 16 bytes."""
        return self._writer.guid.bytes

    @property
    def readers(self) -> int:
        """How many readers are matched."""
        return int(self._writer.get_publication_matched_status().current_count)

    @property
    def refused(self) -> str:
        """The policy for which the last reader that does not match was refused; empty if there was none."""
        return _policy(self._writer.get_offered_incompatible_qos_status())

    def write(self, cdr: bytes) -> bool:
        """Sends a sample that is encoded already; returns False if a reader's buffers stayed full."""
        return bool(ddspy_write(self._writer._ref, cdr) == 0)

    def close(self) -> None:
        """Withdraws the topic: the binding deletes an entity with its last reference."""
        del self._writer


class Reader:
    """Receives one topic of ROS 2; ``receive`` is called with each sample, in a thread of Cyclone."""

    def __init__(
        self,
        participant: "Participant",
        name: str,
        converter: Converter,
        qos: rule.Qos,
        receive: Callable[[bytes], None],
    ) -> None:
        self.converter = converter
        self._receive = receive
        self._closed = False
        listener = Listener()
        listener.set_on_data_available(self._take)
        listener.set_on_subscription_matched(lambda *_: participant.changed())
        listener.set_on_requested_incompatible_qos(lambda *_: participant.changed())
        self._listener = listener
        self._reader = DataReader(
            participant.entity,
            participant.topic(name, converter.type_name),
            qos=_requested(qos, converter),
            listener=listener,
        )
        # What arrived before the binding knew the new reader.
        self._take(self._reader)

    @property
    def guid(self) -> bytes:
        """The reader's identifier in the domain, 16 bytes."""
        return self._reader.guid.bytes

    @property
    def writers(self) -> int:
        """How many writers are matched."""
        return int(self._reader.get_subscription_matched_status().current_count)

    @property
    def refused(self) -> str:
        """The policy for which the last writer that does not match was refused; empty if there was none."""
        return _policy(self._reader.get_requested_incompatible_qos_status())

    def _take(self, reader: DataReader[Any] | None) -> None:
        """Passes on what has arrived; the binding does not know a reader that is being made or deleted: None."""
        if self._closed or reader is None:
            return
        samples = ddspy_take(reader._ref, _ANY_STATE, _MOST_TAKEN)
        if isinstance(samples, int):
            _LOG.error("Cyclone DDS cannot take samples: %s", DDSException(samples))
            return
        for data, info in samples:
            if info.valid_data:
                self._receive(data)

    def close(self) -> None:
        """Withdraws the subscription."""
        self._closed = True
        del self._reader


class _Endpoints:
    """Readers or writers of other participants."""

    def __init__(self, entity: DomainParticipant, topic: Any, changed: Callable[[], None]) -> None:
        self._own = entity.guid
        self._known: dict[Any, tuple[str, str]] = {}
        listener = Listener()
        listener.set_on_data_available(lambda _: changed())
        self._listener = listener
        self._reader = BuiltinDataReader(entity, topic, listener=listener)

    def types(self) -> dict[str, set[str]]:
        """Returns their DDS types by DDS topic."""
        while samples := self._reader.take(N=_MOST_TAKEN):
            for sample in samples:
                info = sample.sample_info
                if not info.valid_data or info.instance_state != InstanceState.Alive:
                    self._known.pop(sample.key, None)
                elif sample.participant_key != self._own:
                    self._known[sample.key] = (sample.topic_name, sample.type_name)
        found: dict[str, set[str]] = {}
        for topic, type_name in self._known.values():
            found.setdefault(topic, set()).add(type_name)
        return found


class Participant:
    """A participant of a ROS 2 domain, with one node.

    Args:
        number: the domain, ``ROS_DOMAIN_ID``.
        node: the node's name, without namespace.
        changed: called, in a thread of Cyclone, when endpoints match or no longer do.

    Raises:
        DDSException: there is no network, or the configuration cannot be read.
    """

    def __init__(
        self, number: int, node: str, messages: MessageTypes, changed: Callable[[], None]
    ) -> None:
        self.changed = changed
        self._samples = SampleTypes(messages)
        self._node = node
        self._topics: dict[tuple[str, str], Topic[Any]] = {}
        # Warnings are of every type description of Fast DDS that Cyclone cannot read, see matching.py; errors of every
        # packet to an address that a peer announced and then lost. What matters comes as a return code.
        DDS._dll_handle.dds_set_log_mask(_ONLY_FATAL)
        chosen = configuration(os.environ)
        given = os.environ.get("CYCLONEDDS_URI", "") if chosen is None else chosen
        self._domain = Domain(number, ",".join(part for part in (given, _NO_LINGER) if part))
        # The enclave of security, which every participant of ROS 2 names.
        self.entity = DomainParticipant(number, qos=Qos(Policy.Userdata(b"enclave=/;")))
        self.matching = Listener()
        self.matching.set_on_publication_matched(lambda *_: changed())
        self.matching.set_on_offered_incompatible_qos(lambda *_: changed())
        self._publications = _Endpoints(self.entity, BuiltinTopicDcpsPublication, changed)
        self._subscriptions = _Endpoints(self.entity, BuiltinTopicDcpsSubscription, changed)
        self._graph = self._graph_writer(messages)

    def topic(self, name: str, type_name: str) -> Topic[Any]:
        """Returns the topic of ROS 2 with this name and type."""
        key = (name, type_name)
        if key not in self._topics:
            topic = Topic(self.entity, dds_topic(name), self._samples.new_struct(type_name))
            match_by_name(topic)
            self._topics[key] = topic
        return self._topics[key]

    def offered(self) -> dict[str, set[str]]:
        """Returns the DDS types under which other participants write, by DDS topic."""
        return self._publications.types()

    def requested(self) -> dict[str, set[str]]:
        """Returns the DDS types under which other participants read, by DDS topic."""
        return self._subscriptions.types()

    def _graph_writer(self, messages: MessageTypes) -> DataWriter[Any]:
        struct = self._samples.struct(_GRAPH_TYPE)
        topic = Topic(self.entity, _GRAPH, struct)
        ignore_type_descriptions(topic)
        match_by_name(topic)
        hashed = Policy.Userdata(f"typehash={messages.type_hash(_GRAPH_TYPE)};".encode())
        qos = Qos(
            Policy.Reliability.Reliable(duration(seconds=1)),
            Policy.Durability.TransientLocal,
            Policy.History.KeepLast(1),
            hashed,
        )
        return DataWriter(self.entity, topic, qos=qos)

    def announce(self, readers: list[bytes], writers: list[bytes]) -> None:
        """Tells ROS 2 which readers and writers the node has; without it ``ros2 node list`` would not show the node."""
        gid = self._samples.struct("rmw_dds_common/Gid")
        node = self._samples.struct("rmw_dds_common/NodeEntitiesInfo")
        graph = self._samples.struct(_GRAPH_TYPE)
        info = node(
            node_namespace="/",
            node_name=self._node,
            reader_gid_seq=[gid(data=list(each)) for each in readers],
            writer_gid_seq=[gid(data=list(each)) for each in writers],
        )
        self._graph.write(
            graph(gid=gid(data=list(self.entity.guid.bytes)), node_entities_info_seq=[info])
        )

    def close(self) -> None:
        """Leaves the domain, with all its readers and writers, so that peers need not wait for a time-out."""
        self.entity._delete(self.entity._ref)
