# SPDX-License-Identifier: Apache-2.0
"""The MCAP container, written: chunks of at most 1 MB, then index, statistics and footer.

Source: the MCAP specification. The library's own writer cuts a chunk only after it has grown too
large, and cannot take over chunks of another file; hence this one, made of the library's records.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from pilotage.atomic_files import GrowingFile

MAGIC = b"\x89MCAP0\r\n"
PROFILE = "ros2"
# With its head a chunk stays within 1 MB.
CHUNK_BYTES = 1_000_000 - 64
# What is not in a chunk yet is lost when the process is killed.
CHUNK_SPAN_NS = 1_000_000_000
# Compressed pictures do not shrink; a chunk is kept as it is unless this share is saved.
WORTH_COMPRESSING = 0.9


class ContainerWriter:
    """Records going into a `GrowingFile`, which is only whole after `finish`.

    A chunk is in the hands of the system before the next one begins: a killed process loses what
    came since, a second at most while messages come. Writing raises RunError naming the file; what
    it holds then are whole records.
    """

    def __init__(self, file: GrowingFile, *, library: str, profile: str = PROFILE) -> None:
        self._file = file
        self._header = Header(profile, library)
        self._chunk = _OpenChunk()
        self._crc = 0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._chunk_indexes: list[ChunkIndex] = []
        self._attachment_indexes: list[AttachmentIndex] = []
        self._metadata_indexes: list[MetadataIndex] = []
        self._start_ns: int | None = None
        self._end_ns = 0

    def start(self) -> None:
        """Write magic and header; comes first."""
        self._write(MAGIC + record_bytes(self._header))

    def add_schema(self, schema: Schema) -> None:
        """Name a type of message; it is repeated in the summary."""
        if schema.id not in self._schemas:
            self._schemas[schema.id] = schema
            schema.write(self._chunk.records)

    def add_channel(self, channel: Channel) -> None:
        """Name a topic, whose schema is known already."""
        if channel.id not in self._channels:
            self._channels[channel.id] = channel
            channel.write(self._chunk.records)

    def add_metadata(self, metadata: Metadata) -> None:
        """Write names and texts that say something of the whole file."""
        self.flush()
        data = record_bytes(metadata)
        place = MetadataIndex(offset=self._file.size, length=len(data), name=metadata.name)
        self._write(data)
        self._metadata_indexes.append(place)

    def add_message(self, message: Message) -> None:
        """Put a message of a known channel into the chunk, a new one where it does not fit."""
        begin_ns = self._chunk.start_ns
        is_late = begin_ns is not None and message.log_time - begin_ns > CHUNK_SPAN_NS
        is_full = self._chunk.records.count + len(message.data) + 31 > CHUNK_BYTES
        if (is_late or is_full) and begin_ns is not None:
            self.flush()
        self._chunk.add(message)
        if self._chunk.records.count > CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write the chunk so far; nothing where it is empty."""
        if self._chunk.records.count == 0:
            return
        chunk, indexes = self._chunk.end()
        self._chunk = _OpenChunk()
        self._write_chunk(record_bytes(chunk), chunk, indexes)

    def copy_chunk(self, body: bytes, chunk: Chunk, records: list[tuple[int, McapRecord]]) -> None:
        """Take over a chunk: its record's `body`, parsed, and its records with their offsets."""
        self.flush()
        indexes: dict[int, MessageIndex] = {}
        for offset, record in records:
            if isinstance(record, Schema):
                self._schemas.setdefault(record.id, record)
            elif isinstance(record, Channel):
                self._channels.setdefault(record.id, record)
            elif isinstance(record, Message):
                _note(indexes, record, offset)
        self._write_chunk(struct.pack("<BQ", Opcode.CHUNK, len(body)) + body, chunk, indexes)

    def copy_record(self, body: bytes, index: AttachmentIndex | MetadataIndex) -> None:
        """Take over an attachment or a metadata record; its place is filled into `index`."""
        self.flush()
        is_attachment = isinstance(index, AttachmentIndex)
        opcode = Opcode.ATTACHMENT if is_attachment else Opcode.METADATA
        index.offset, index.length = self._file.size, len(body) + 9
        self._write(struct.pack("<BQ", opcode, len(body)) + body)
        if isinstance(index, AttachmentIndex):
            self._attachment_indexes.append(index)
        else:
            self._metadata_indexes.append(index)

    def finish(self) -> None:
        """Write the last chunk, index, statistics and footer: the file is whole then."""
        self.flush()
        self._write(record_bytes(DataEnd(self._crc)))
        start = self._file.size
        summary, offsets = self._summary(start)
        self._write(summary)
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, start + offsets)
        crc = zlib.crc32(footer, zlib.crc32(summary))
        self._write(record_bytes(Footer(start, start + offsets, crc)) + MAGIC)

    def _write_chunk(self, data: bytes, chunk: Chunk, indexes: dict[int, MessageIndex]) -> None:
        start, offsets, tail = self._file.size, {}, b""
        for channel_id, index in indexes.items():
            offsets[channel_id] = start + len(data) + len(tail)
            tail += record_bytes(index)
        self._write(data + tail)
        self._chunk_indexes.append(
            ChunkIndex(
                chunk_start_offset=start, chunk_length=len(data), compression=chunk.compression,
                compressed_size=len(chunk.data), message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time, message_index_length=len(tail),
                message_index_offsets=offsets, uncompressed_size=chunk.uncompressed_size,
            )
        )  # fmt: skip
        for channel_id, index in indexes.items():
            self._counts[channel_id] += len(index.records)
            times_ns = [time_ns for time_ns, _ in index.records]
            earliest = min(times_ns)
            self._start_ns = earliest if self._start_ns is None else min(self._start_ns, earliest)
            self._end_ns = max(self._end_ns, *times_ns)

    def _summary(self, start: int) -> tuple[bytes, int]:
        """Return the summary, and where in it the summary's own offsets begin."""
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, [*self._schemas.values()]),
            (Opcode.CHANNEL, [*self._channels.values()]),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, [*self._chunk_indexes]),
            (Opcode.ATTACHMENT_INDEX, [*self._attachment_indexes]),
            (Opcode.METADATA_INDEX, [*self._metadata_indexes]),
        ]
        builder, offsets = RecordBuilder(), []
        for opcode, group in groups:
            begin = builder.count
            for record in group:
                record.write(builder)
            if group:
                offsets.append(SummaryOffset(opcode, start + begin, builder.count - begin))
        offsets_begin = builder.count
        for offset in offsets:
            offset.write(builder)
        return builder.end(), offsets_begin

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachment_indexes), channel_count=len(self._channels),
            channel_message_counts=dict(self._counts), chunk_count=len(self._chunk_indexes),
            message_count=self._counts.total(), message_start_time=self._start_ns or 0,
            message_end_time=self._end_ns, metadata_count=len(self._metadata_indexes),
            schema_count=len(self._schemas),
        )  # fmt: skip

    def _write(self, data: bytes) -> None:
        self._file.append(data)
        self._crc = zlib.crc32(data, self._crc)


class _OpenChunk:
    """Records that are not written yet."""

    def __init__(self) -> None:
        self.records = RecordBuilder()
        self.start_ns: int | None = None
        self._end_ns = 0
        self._indexes: dict[int, MessageIndex] = {}

    def add(self, message: Message) -> None:
        _note(self._indexes, message, self.records.count)
        time_ns = message.log_time
        self.start_ns = time_ns if self.start_ns is None else min(self.start_ns, time_ns)
        self._end_ns = max(self._end_ns, time_ns)
        message.write(self.records)

    def end(self) -> tuple[Chunk, dict[int, MessageIndex]]:
        """Return the chunk, compressed where that pays, and where each channel's messages are."""
        plain = self.records.end()
        packed = zstandard.ZstdCompressor(level=1).compress(plain)
        pays = len(packed) < WORTH_COMPRESSING * len(plain)
        chunk = Chunk(
            compression="zstd" if pays else "",
            data=packed if pays else plain,
            message_start_time=self.start_ns or 0,
            message_end_time=self._end_ns,
            uncompressed_crc=zlib.crc32(plain),
            uncompressed_size=len(plain),
        )
        return chunk, self._indexes


def _note(indexes: dict[int, MessageIndex], message: Message, offset: int) -> None:
    """Add a message that begins at `offset` of its chunk to its channel's index."""
    index = indexes.setdefault(message.channel_id, MessageIndex(message.channel_id, []))
    index.records.append((message.log_time, offset))


def record_bytes(record: McapRecord) -> bytes:
    """Return a record as it stands in a file."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())
