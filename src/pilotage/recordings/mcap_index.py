# SPDX-License-Identifier: Apache-2.0
"""Where the messages of an MCAP file are, and the messages themselves, a few chunks in memory."""

from __future__ import annotations

from array import array
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Self

from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from pilotage.errors import InputError
from pilotage.recordings import ros_messages as ros
from pilotage.recordings.mcap_container import MAGIC
from pilotage.recordings.mcap_records import (
    HEAD_BYTES,
    MESSAGE_HEAD_BYTES,
    DamageError,
    RawRecord,
    parse_channel,
    parse_chunk,
    parse_message,
    parse_metadata,
    parse_schema,
    raw_records,
    split_chunk,
    unpack_chunk,
)
from pilotage.recordings.mcap_writer import PART_SUFFIX, STATIC_TRANSFORMS_TOPIC

FILE_NAME = "recording.mcap"
TOP_LEVEL = -1  # instead of a chunk's offset: a message outside of chunks
CACHED_BYTES = 8 << 20
# Topics of which the first messages are kept; more would say the same again.
KEPT_MESSAGES = 1000
LISTED_TYPES = (ros.IMAGE, ros.COMPRESSED_IMAGE, ros.POSE, ros.ODOMETRY, ros.JOINTS)
KNOWN_TYPES = (*LISTED_TYPES, ros.CAMERA_INFO, ros.TRANSFORMS)


@dataclass
class Topic:
    """A topic's messages: each one's time and place, or its `first` ones as bytes.

    Times are of the header's stamp; where it says nothing or there is none, of the log.
    """

    name: str
    type_name: str
    metadata: dict[str, str]
    times_ns: array[int] = field(default_factory=lambda: array("q"))
    chunks: array[int] = field(default_factory=lambda: array("q"))
    offsets: array[int] = field(default_factory=lambda: array("q"))
    sizes: array[int] = field(default_factory=lambda: array("q"))
    first: list[bytes] = field(default_factory=list)

    def add(self, message: Message, chunk: int, offset: int) -> None:
        """Note a message whose data begin at `offset` of a chunk's content, or of the file."""
        is_static = self.name == STATIC_TRANSFORMS_TOPIC
        if self.type_name == ros.CAMERA_INFO or is_static:
            if len(self.first) < (KEPT_MESSAGES if is_static else 1):
                self.first.append(message.data)
            return
        has_stamp = self.type_name != ros.TRANSFORMS  # a list of transforms, each with its own
        self.times_ns.append(_time_ns(message) if has_stamp else message.log_time)
        self.chunks.append(chunk)
        self.offsets.append(offset)
        self.sizes.append(len(message.data))


def find_file(path: Path) -> Path:
    """Return the .mcap file that `path` is or holds; InputError unless it is one, and finished."""
    files = [path] if path.is_file() else mcap_files(path)
    if len(files) != 1:
        raise InputError(f"{path}: holds {len(files)} .mcap files; name one of them")
    if files[0].name.endswith(PART_SUFFIX):
        raise InputError(f"{files[0]}: was never finished; `pilotage recover` makes it whole")
    return files[0]


def is_mcap(path: Path) -> bool:
    """Tell by the name's end, of the file or of what a folder holds."""
    names = (".mcap", f".mcap{PART_SUFFIX}")
    return bool(path.name.endswith(names) and path.is_file()) or bool(mcap_files(path))


def mcap_files(path: Path) -> list[Path]:
    """Return a folder's recording, or all it holds where none has the usual name.

    Of one that was never finished what is there, where nothing else is.
    """
    if not path.is_dir():
        return []
    usual, begun = path / FILE_NAME, path / (FILE_NAME + PART_SUFFIX)
    if usual.is_file():
        return [usual]
    whole = sorted(f for f in path.glob("*.mcap") if f.is_file())
    return whole or ([begun] if begun.is_file() else [])


def read_index(path: Path) -> dict[str, Topic]:
    """Return the topics of pictures, calibration, transforms, poses and joints, by name.

    Reads the file once and checks it whole; InputError says what is wrong and the remedy.
    """
    try:
        with path.open("rb") as file:
            return _Indexer().read(file)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except DamageError as error:
        raise InputError(f"{path}: {error}; `pilotage recover` keeps what is whole of it") from None


def read_metadata(path: Path, name: str) -> dict[str, str] | None:
    """Return the record of that name that says something of the whole file; None without.

    Of a file that is cut off, what is there. InputError where it is no MCAP file.
    """
    try:
        with path.open("rb") as file:
            for record in raw_records(file, only=Opcode.METADATA):
                if record.opcode == Opcode.METADATA and record.is_whole:
                    found = parse_metadata(record.body)
                    if found.name == name:
                        return dict(found.metadata)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except DamageError as error:
        raise InputError(f"{path}: {error}; `pilotage recover` keeps what is whole of it") from None
    return None


class _Indexer:
    def __init__(self) -> None:
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Topic | None] = {}
        self._topics: dict[str, Topic] = {}

    def read(self, file: BinaryIO) -> dict[str, Topic]:
        last = None
        for record in raw_records(file):
            last = record
            if not record.is_whole:
                break
            self._take(record)
        if last is None or last.opcode != Opcode.FOOTER or not last.is_whole:
            raise DamageError("cut off: it has no footer")
        if file.read(len(MAGIC)) != MAGIC:
            raise DamageError("cut off: it does not end as an MCAP file does")
        return self._topics

    def _take(self, record: RawRecord) -> None:
        if record.opcode == Opcode.CHUNK:
            content = unpack_chunk(parse_chunk(record.body))
            for inner in split_chunk(content):
                if not inner.is_whole:
                    raise DamageError(f"byte {record.offset}: a chunk whose last record is cut off")
                self._take_inner(inner, record.offset)
        else:
            self._take_inner(record, TOP_LEVEL)

    def _take_inner(self, record: RawRecord, chunk: int) -> None:
        if record.opcode == Opcode.SCHEMA:
            schema = parse_schema(record.body)
            self._schemas[schema.id] = schema
        elif record.opcode == Opcode.CHANNEL:
            self._add_channel(parse_channel(record.body))
        elif record.opcode == Opcode.MESSAGE:
            message = parse_message(record.body)
            if message.channel_id not in self._channels:
                raise DamageError(f"a message of channel {message.channel_id}, which is not told")
            topic = self._channels[message.channel_id]
            if topic is not None:
                topic.add(message, chunk, record.offset + HEAD_BYTES + MESSAGE_HEAD_BYTES)

    def _add_channel(self, channel: Channel) -> None:
        schema = self._schemas.get(channel.schema_id)
        wanted = schema is not None and schema.name in KNOWN_TYPES
        if schema is None or not wanted or channel.message_encoding != "cdr":
            self._channels[channel.id] = None
            return
        # Two channels of one topic are two who publish on it.
        topic = self._topics.setdefault(
            channel.topic, Topic(channel.topic, schema.name, channel.metadata)
        )
        self._channels[channel.id] = topic if topic.type_name == schema.name else None


def _time_ns(message: Message) -> int:
    try:
        stamp_ns = ros.read_stamp_ns(message.data)
    except ros.MessageError:
        stamp_ns = 0
    time_ns = stamp_ns if stamp_ns > 0 else message.log_time
    if time_ns >= 2**63:
        raise DamageError(f"a message of time {time_ns} ns")
    return time_ns


class MessageFetcher:
    """Messages by their place. `with` opens the file; chunks worth 8 MB stay in memory."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: BinaryIO | None = None
        self._contents: OrderedDict[int, bytes] = OrderedDict()

    def __enter__(self) -> Self:
        self._file = self._path.open("rb")
        return self

    def __exit__(self, *error: object) -> None:
        if self._file is not None:
            self._file.close()
        self._file = None
        self._contents.clear()

    def fetch(self, topic: Topic, number: int) -> bytes:
        """Return the data of a topic's message; DamageError where the file changed meanwhile."""
        chunk, offset = topic.chunks[number], topic.offsets[number]
        size = topic.sizes[number]
        if chunk == TOP_LEVEL:
            data = self._read(offset, size)
        else:
            data = self._content(chunk)[offset : offset + size]
        if len(data) != size:
            raise DamageError("the file has changed while it was read")
        return data

    def fetch_all(self, topic: Topic) -> Iterator[tuple[int, bytes]]:
        """Yield time, ns, and data of each of a topic's messages."""
        for number, time_ns in enumerate(topic.times_ns):
            yield time_ns, self.fetch(topic, number)

    def _content(self, chunk: int) -> bytes:
        if chunk in self._contents:
            self._contents.move_to_end(chunk)
            return self._contents[chunk]
        head = self._read(chunk, HEAD_BYTES)
        record = parse_chunk(self._read(chunk + HEAD_BYTES, int.from_bytes(head[1:], "little")))
        content = unpack_chunk(record)
        self._contents[chunk] = content
        while len(self._contents) > 1 and sum(map(len, self._contents.values())) > CACHED_BYTES:
            self._contents.popitem(last=False)
        return content

    def _read(self, offset: int, size: int) -> bytes:
        if self._file is None:
            raise ValueError(f"{self._path} is not open; use it in a `with`")
        try:
            self._file.seek(offset)
            return self._file.read(size)
        except (OSError, OverflowError, MemoryError) as error:
            raise DamageError(f"cannot be read ({error})") from error
