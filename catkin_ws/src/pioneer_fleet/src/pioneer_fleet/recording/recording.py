"""Reads and writes recordings: serialised messages in MCAP files (``.mcap``) or ROS 1 bags (``.bag``)."""

import contextlib
import errno
import logging
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pioneer_fleet.printable import printable
from pioneer_fleet.recording.salvage import Losses, has_end, is_recording, salvaged_rows

_ENCODING = "ros1msg"
_LOGGER = logging.getLogger("rosout")


class Kind(NamedTuple):
    """What one publisher of a topic sends, from its connection header."""

    type: str
    md5sum: str
    definition: str
    latching: bool
    sender: str = ""  #: name of the publisher's node; empty if the recording does not have it

    def message_class(self, *bases: Any) -> Any:
        """Returns a class for its serialised messages."""
        return type(
            "Raw",
            bases,
            {"_type": self.type, "_md5sum": self.md5sum, "_full_text": self.definition},
        )


class Message(NamedTuple):
    """A recorded message; the topic begins with its master's name, and the time is wall time [ns]."""

    topic: str
    kind: Kind
    time: int
    data: bytes


class RecordingError(Exception):
    """The file is not a valid recording; the message is one line."""


class McapFile:
    """Writes an MCAP file."""

    def __init__(self, path: Path) -> None:
        from mcap.writer import Writer as Mcap

        self._file = path.open("wb")
        self._mcap = Mcap(self._file)
        self._mcap.start("ros1", "pioneer_fleet")
        self._schemas: dict[tuple[str, str], int] = {}
        self._channels: dict[tuple[str, Kind], int] = {}

    def add(self, message: Message) -> None:
        """Writes one message."""
        topic, kind, time, data = message
        if (topic, kind) not in self._channels:
            own = (kind.type, kind.md5sum)
            if own not in self._schemas:
                self._schemas[own] = self._mcap.register_schema(
                    kind.type, _ENCODING, kind.definition.encode()
                )
            about = {"md5sum": kind.md5sum, "latching": str(int(kind.latching))}
            if kind.sender:
                about["callerid"] = kind.sender
            self._channels[topic, kind] = self._mcap.register_channel(
                topic, "ros1", self._schemas[own], about
            )
        self._mcap.add_message(self._channels[topic, kind], time, data, time)

    def flush(self) -> None:
        """Writes what was added to the disk, so that it can be read whatever happens to this process."""
        self._mcap.flush()

    def close(self) -> None:
        """Completes the file."""
        self._mcap.finish()
        self._file.close()


class BagFile:
    """Writes a ROS 1 bag, compressed by LZ4. rosbag's own writer would note one sender for each topic."""

    def __init__(self, path: Path) -> None:
        import roslz4
        from rosbags.rosbag1 import Writer

        _remove_file(path)
        self._bag = Writer(path)
        self._bag.set_compression(Writer.CompressionFormat.LZ4)
        # rosbag reads LZ4 only if its blocks do not refer to one another, as in what roslz4 writes.
        self._bag.compressor = roslz4.compress
        self._bag.open()
        self._connections: dict[tuple[str, Kind], Any] = {}

    def add(self, message: Message) -> None:
        """Writes one message."""
        from rosbags.typesys.msg import normalize_msgtype

        key = (message.topic, message.kind)
        if key not in self._connections:
            kind = message.kind
            self._connections[key] = self._bag.add_connection(
                message.topic,
                normalize_msgtype(kind.type),
                msgdef=kind.definition,
                md5sum=kind.md5sum,
                callerid=kind.sender or None,
                latching=int(kind.latching),
            )
        self._bag.write(self._connections[key], message.time, message.data)

    def flush(self) -> None:
        """Writes what was added to the disk, so that it can be read whatever happens to this process."""
        self._bag.write_chunk(self._bag.chunks[-1])
        if self._bag.bio is not None:
            self._bag.bio.flush()

    def close(self) -> None:
        """Completes the file."""
        self._bag.close()


def _remove_file(path: Path) -> None:
    """Removes the file that a new one replaces; of a link, the file that it names.

    Raises:
        OSError: it is no regular file.
    """
    if path.exists() and not path.is_file():
        raise FileExistsError(errno.EEXIST, "is no regular file")
    path.resolve().unlink(missing_ok=True)


def messages_of(path: Path) -> Iterator[Message]:
    """Yields a recording's messages in chronological order; of an incomplete one, in the order of the file.

    Logs what is missing of an incomplete one: before the first message that it is incomplete, after the last how much.

    Raises:
        RecordingError: the file is not a recording, or is damaged.
        OSError: it cannot be read.
    """
    if not is_complete(path):
        losses = Losses()
        _LOGGER.warning(
            "%s is incomplete: what can be read is used (--repair NEW writes it to a new file)",
            printable(str(path), ""),
        )
        yield from salvaged(path, losses)
        for line in losses.lines:
            _LOGGER.warning("%s: %s", printable(str(path), ""), line)
        return
    if path.suffix == ".bag":
        yield from _of_bag(path)
        return
    with _mcap(path) as reader:
        yield from _messages(reader.iter_messages())


def is_complete(path: Path) -> bool:
    """Returns whether a recording has its end, with the index.

    Raises:
        RecordingError: the file is not a recording.
        OSError: it cannot be read.
    """
    if not is_recording(path):
        kind = "bag" if path.suffix == ".bag" else "MCAP file"
        raise RecordingError(f"{path} is not a complete {kind}: it does not begin as one")
    if path.suffix != ".bag":
        return has_end(path)
    import rosbag

    try:
        with rosbag.Bag(str(path)):
            return True
    except _bag_errors():
        return False


def topics_of(path: Path) -> set[str]:
    """Returns the topics of a recording, from its index if it has one.

    Raises:
        RecordingError: the file is not a recording, or is damaged.
        OSError: it cannot be read.
    """
    if not is_complete(path):
        return {message.topic for message in salvaged(path, Losses())}
    if path.suffix != ".bag":
        with _mcap(path) as reader:
            summary = reader.get_summary()
            if summary is not None and summary.channels:
                return {channel.topic for channel in summary.channels.values()}
        return {message.topic for message in messages_of(path)}
    import rosbag

    try:
        with rosbag.Bag(str(path)) as bag:
            return set(bag.get_type_and_topic_info().topics)
    except _bag_errors() as error:
        raise _named(path, error) from None


def salvaged(path: Path, losses: Losses) -> Iterator[Message]:
    """Yields the messages that can be read of an incomplete or damaged recording, in the order of the file.

    Args:
        path: the recording.
        losses: takes what is missing.

    Raises:
        OSError: it cannot be read.
    """
    for topic, header, moment, data in salvaged_rows(path, losses):
        kind = Kind(
            type=header.get("type", ""),
            md5sum=header.get("md5sum", "*"),
            definition=header.get("message_definition", ""),
            latching=header.get("latching") == "1",
            sender=header.get("callerid", ""),
        )
        yield Message(topic, kind, moment, data)


def repair(path: Path, new: Path) -> tuple[int, Losses]:
    """Writes what can be read of a recording to a new, complete one.

    Returns:
        The number of its messages, and what is missing.

    Raises:
        RecordingError: the file is not a recording.
        OSError: one cannot be read, the other one exists or cannot be written.
    """
    if not is_recording(path):
        raise RecordingError(f"{path} is no recording")
    if new.exists():
        raise FileExistsError(errno.EEXIST, "it exists already", str(new))
    losses = Losses()
    count = 0
    writer = writer_of(new)
    for message in salvaged(path, losses):
        writer.add(message)
        count += 1
    writer.close()
    return count, losses


def writer_of(path: Path) -> BagFile | McapFile:
    """Returns a writer for a new recording: a bag, or an MCAP file.

    Raises:
        OSError: it cannot be written.
    """
    return BagFile(path) if path.suffix == ".bag" else McapFile(path)


class Contents(NamedTuple):
    """Contents of an MCAP file: times of its first and last message [ns], and its topics."""

    begin: int
    end: int
    topics: Sequence[str]


def contents(path: Path) -> Contents:
    """Returns the contents of an MCAP file from its index.

    Raises:
        RecordingError: it is not a complete MCAP file.
        OSError: it cannot be read.
    """
    with _mcap(path) as reader:
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            raise RecordingError(f"{path} has no index")
        topics = sorted(channel.topic for channel in summary.channels.values())
        return Contents(
            summary.statistics.message_start_time, summary.statistics.message_end_time, topics
        )


def messages_since(path: Path, since: int) -> Iterator[Message]:
    """Yields an MCAP file's messages from time ``since`` [ns] on, preceded by the latched messages valid at that time.

    Raises:
        RecordingError: it is not a complete MCAP file.
        OSError: it cannot be read.
    """
    with _mcap(path) as reader:
        channels = reader.get_summary().channels.values()
        latched = [one.topic for one in channels if one.metadata.get("latching") == "1"]
        before = reader.iter_messages(topics=latched, ending_before=since) if latched else ()
        newest = {(row[1].topic, row[1].id): row for row in before}
        yield from _messages(newest.values())
        yield from _messages(reader.iter_messages(starting_at=since))


@contextlib.contextmanager
def _mcap(path: Path) -> Iterator[Any]:
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
    from zstandard import ZstdError

    try:
        with path.open("rb") as file:
            yield make_reader(file, validate_crcs=True)
    except (
        McapError, ZstdError, struct.error, ValueError, KeyError, OverflowError, MemoryError,
    ) as error:  # fmt: skip
        raise RecordingError(
            f"{path} is not a complete MCAP file: {error or type(error).__name__} "
            "(./pioneer replay FILE --repair NEW writes what can be read)"
        ) from None


def _messages(rows: Iterable[tuple[Any, Any, Any]]) -> Iterator[Message]:
    kinds: dict[tuple[int, int], Kind] = {}
    for schema, channel, message in rows:
        if schema is None or schema.encoding != _ENCODING:
            continue
        key = (schema.id, channel.id)
        if key not in kinds:
            about: Mapping[str, str] = channel.metadata
            kinds[key] = Kind(
                type=schema.name,
                md5sum=about.get("md5sum", "*"),
                definition=_definition(schema.data, schema.name, channel.topic),
                latching=about.get("latching") == "1",
                sender=about.get("callerid", ""),
            )
        yield Message(channel.topic, kinds[key], message.log_time, message.data)


def _definition(data: bytes, name: str, topic: str) -> str:
    """Returns a schema's text. The messages can be played without it, so invalid bytes are replaced with a warning."""
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        _LOGGER.warning(
            "%s: the definition of %s is not UTF-8 (%s at byte %d) and is passed on with replacement characters",
            printable(topic, ""),
            printable(name, ""),
            error.reason,
            error.start,
        )
        return data.decode(errors="replace")


def _of_bag(path: Path) -> Iterator[Message]:
    import rosbag

    kinds: dict[tuple[str, str, bool, str], Kind] = {}
    try:
        with rosbag.Bag(str(path)) as bag:
            for topic, raw, time, header in bag.read_messages(
                raw=True, return_connection_header=True
            ):
                latching = header.get("latching") in (b"1", "1")
                sender = header.get("callerid", "")
                if isinstance(sender, bytes):
                    sender = sender.decode(errors="replace")
                key = (topic, raw[2], latching, sender)
                if key not in kinds:
                    definition = header.get("message_definition", b"")
                    if isinstance(definition, bytes):
                        definition = _definition(definition, raw[0], topic)
                    kinds[key] = Kind(raw[0], raw[2], definition, latching, sender)
                yield Message(topic, kinds[key], time.to_nsec(), raw[1])
    except _bag_errors() as error:
        raise _named(path, error) from None


def _named(path: Path, error: Exception) -> Exception:
    """Returns what to raise for an error of rosbag: the same for a file that cannot be read, else one with its name."""
    if isinstance(error, OSError) and error.errno is not None:
        return error
    reason = str(error) or type(error).__name__
    return RecordingError(
        f"{path} is not a complete bag: {reason} (./pioneer replay FILE --repair NEW writes what can be read)"
    )


def _bag_errors() -> tuple[type[Exception], ...]:
    """Returns what rosbag raises for bags that it cannot read."""
    import rosbag

    return (
        rosbag.ROSBagException, struct.error, ValueError, KeyError, OverflowError, MemoryError,
        OSError, EOFError, RuntimeError,  # of bz2 and lz4
    )  # fmt: skip
