"""Reads what can be read of an incomplete or damaged recording, such as one whose recorder was killed.

Files consist of chunks, which are compressed one by one. A chunk that is damaged is left out; what follows a record
that the file's end cuts is lost. Messages come in the order of the file.
"""

import bz2
import dataclasses
import io
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

_MCAP_MAGIC = b"\x89MCAP0\r\n"
_BAG_MAGIC = b"#ROSBAG V2.0\n"
_MCAP_PREFIX = struct.Struct("<BQ")
"""Kind and length of a record of an MCAP file."""
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7
"""Kinds of a bag's records, of those that are read here."""
_SECOND = 10**9


class Row(NamedTuple):
    """A message of a file, with its publisher's connection header; the time is wall time [ns]."""

    topic: str
    header: dict[str, str]
    time: int
    data: bytes


@dataclasses.dataclass
class Losses:
    """What is missing of a recording that was read."""

    damaged: list[str] = dataclasses.field(default_factory=list)  #: a line for each chunk
    unknown: int = 0  #: number of messages whose topic was in a damaged chunk
    cut: int = 0  #: number of bytes at the end that belong to no complete record
    is_closed: bool = False  #: whether the recorder has completed the file
    last: int = 0  #: time of the last message [ns]; 0 without any

    @property
    def lines(self) -> list[str]:
        """A line for each thing that is missing; empty for a complete recording."""
        found = list(self.damaged)
        if self.unknown:
            found.append(f"{self.unknown} messages have topics that were named in damaged parts")
        if not self.is_closed:
            until = f"what was recorded after {clock(self.last)}" if self.last else "all"
            parts = f" ({self.cut} bytes of it are there)" if self.cut else ""
            found.append(f"it was not completed: {until} is lost{parts}")
        return found


def clock(moment: int) -> str:
    """Returns a recorded time [ns] as a local date and time."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(moment / _SECOND))


def is_recording(path: Path) -> bool:
    """Returns whether a file begins as an MCAP file or a bag, each by its suffix."""
    magic = _BAG_MAGIC if path.suffix == ".bag" else _MCAP_MAGIC
    with path.open("rb") as file:
        return file.read(len(magic)) == magic


def has_end(path: Path) -> bool:
    """Returns whether a file ends as an MCAP file."""
    with path.open("rb") as file:
        size = file.seek(0, io.SEEK_END)
        file.seek(max(0, size - len(_MCAP_MAGIC)))
        return size > 2 * len(_MCAP_MAGIC) and file.read() == _MCAP_MAGIC


def salvaged_rows(path: Path, losses: Losses) -> Iterator[Row]:
    """Yields the messages that can be read, and notes in ``losses`` what cannot, complete once the last is taken.

    Raises:
        OSError: the file cannot be read.
    """
    read = _bag_rows if path.suffix == ".bag" else _mcap_rows
    with path.open("rb") as file:
        for row in read(file, losses):
            losses.last = max(losses.last, row.time)
            yield row


def _mcap_rows(file: BinaryIO, losses: Losses) -> Iterator[Row]:
    from mcap.records import Channel, Chunk, DataEnd, Message, Schema
    from mcap.stream_reader import breakup_chunk

    schemas: dict[int, Schema] = {}
    headers: dict[int, tuple[str, dict[str, str]]] = {}
    for record in _mcap_records(file, losses):
        inner: list[Any] = [record]
        if isinstance(record, DataEnd):
            losses.is_closed = True
            return
        if isinstance(record, Chunk):
            try:
                inner = breakup_chunk(record, validate_crc=True)
            except _mcap_errors():
                losses.damaged.append(_damaged(record.message_start_time, record.message_end_time))
                continue
        for one in inner:
            if isinstance(one, Schema):
                schemas[one.id] = one
            elif isinstance(one, Channel):
                schema = schemas.get(one.schema_id)
                if schema is not None and schema.encoding == "ros1msg":
                    headers[one.id] = (one.topic, _mcap_header(one, schema))
            elif isinstance(one, Message):
                if one.channel_id in headers:
                    yield Row(*headers[one.channel_id], one.log_time, one.data)
                else:
                    losses.unknown += 1


def _mcap_records(file: BinaryIO, losses: Losses) -> Iterator[Any]:
    """Yields the records of an MCAP file that can be read: a damaged one is left out, by its length."""
    from mcap.stream_reader import StreamReader

    size = file.seek(0, io.SEEK_END)
    begin = file.seek(len(_MCAP_MAGIC))
    while begin < size:
        prefix = file.read(_MCAP_PREFIX.size)
        if len(prefix) < _MCAP_PREFIX.size:
            break
        _, length = _MCAP_PREFIX.unpack(prefix)
        end = begin + len(prefix) + length
        if end > size:
            break
        reader = StreamReader(
            io.BytesIO(prefix + file.read(length)), skip_magic=True, emit_chunks=True
        )
        try:
            record = next(reader.records)
        except StopIteration:
            record = None
        except _mcap_errors():
            record = None
            losses.damaged.append(f"{length} bytes at byte {begin} are damaged")
        begin = end
        if record is not None:
            yield record
    losses.cut = size - begin


def _mcap_errors() -> tuple[type[BaseException], ...]:
    """Returns what the libraries raise for damaged bytes: odd sizes, codes and texts, wrong checksums."""
    from mcap.exceptions import McapError
    from zstandard import ZstdError

    # CRCValidationError and UnicodeDecodeError are ValueErrors.
    return (McapError, ZstdError, struct.error, ValueError, OverflowError, MemoryError)


def _mcap_header(channel: Any, schema: Any) -> dict[str, str]:
    definition = schema.data.decode(errors="replace")
    return {**channel.metadata, "type": schema.name, "message_definition": definition}


def _damaged(begin: int, end: int) -> str:
    return f"what was recorded from {clock(begin)} to {clock(end)} is damaged"


def _bag_rows(file: BinaryIO, losses: Losses) -> Iterator[Row]:
    size = file.seek(0, io.SEEK_END)
    file.seek(len(_BAG_MAGIC))
    headers: dict[int, tuple[str, dict[str, str]]] = {}
    while True:
        begin = file.tell()
        try:
            fields, data = _bag_record(file)
        except (EOFError, ValueError, MemoryError):
            # After the chunks there is the index; a recorder that was killed has not written it.
            losses.cut = size - begin
            break
        if begin == len(_BAG_MAGIC):
            losses.is_closed = 0 < _number(fields.get("index_pos", b"")) <= size
        if fields.get("op") != bytes([_CHUNK]):
            continue
        try:
            chunk = _uncompressed(fields, data)
            rows = list(_chunk_rows(chunk, headers, losses))
        except (EOFError, OSError, ValueError, RuntimeError, KeyError, struct.error, MemoryError):
            losses.damaged.append(f"{len(data)} bytes at byte {begin} are damaged")
            continue
        yield from rows
    if losses.cut:
        losses.is_closed = False


def _chunk_rows(
    chunk: bytes, headers: dict[int, tuple[str, dict[str, str]]], losses: Losses
) -> Iterator[Row]:
    inner = io.BytesIO(chunk)
    while inner.tell() < len(chunk):
        fields, data = _bag_record(inner)
        connection = _number(fields.get("conn", b""))
        if fields.get("op") == bytes([_CONNECTION]):
            own = {name: value.decode(errors="replace") for name, value in _fields(data).items()}
            headers[connection] = (fields["topic"].decode(errors="replace"), own)
        elif fields.get("op") == bytes([_MESSAGE]):
            seconds, nanoseconds = struct.unpack("<II", fields["time"])
            if connection in headers:
                yield Row(*headers[connection], seconds * _SECOND + nanoseconds, data)
            else:
                losses.unknown += 1


def _uncompressed(fields: dict[str, bytes], data: bytes) -> bytes:
    """Returns a chunk's content.

    Raises:
        ValueError, OSError, RuntimeError: it is damaged, or compressed in an unknown way.
    """
    compression = fields.get("compression", b"none")
    if compression == b"none":
        return data
    if compression == b"bz2":
        return bz2.decompress(data)
    if compression == b"lz4":
        import roslz4

        decompress: Callable[[bytes], bytes] = roslz4.decompress
        return decompress(data)
    raise ValueError(f"unknown compression {compression!r}")


def _bag_record(file: Any) -> tuple[dict[str, bytes], bytes]:
    """Returns the next record's header fields and data.

    Raises:
        EOFError: the file ends before.
        ValueError: it is no record.
    """
    return _fields(_sized(file)), _sized(file)


def _sized(file: Any) -> bytes:
    prefix = file.read(4)
    if len(prefix) < 4:
        raise EOFError
    (length,) = struct.unpack("<I", prefix)
    data: bytes = file.read(length)
    if len(data) < length:
        raise EOFError
    return data


def _fields(header: bytes) -> dict[str, bytes]:
    fields: dict[str, bytes] = {}
    rest = header
    while rest:
        if len(rest) < 4:
            raise ValueError("a header field has no length")
        (length,) = struct.unpack_from("<I", rest)
        name, equals, value = rest[4 : 4 + length].partition(b"=")
        if not equals or len(rest) < 4 + length:
            raise ValueError("a header field has no value")
        fields[name.decode(errors="replace")] = value
        rest = rest[4 + length :]
    return fields


def _number(data: bytes) -> int:
    return int.from_bytes(data, "little")
