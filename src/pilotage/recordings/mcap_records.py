# SPDX-License-Identifier: Apache-2.0
"""The MCAP container, read: records one after the other, none trusted before it is checked.

The library's readers want a whole, honest file; these work on what is left of a broken one.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import Any, BinaryIO, TypeVar

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema

from pilotage.recordings.mcap_container import MAGIC

# No honest record is larger; a size that lies must not cost memory.
LARGEST_RECORD_BYTES = 1 << 30
HEAD_BYTES = 9
MESSAGE_HEAD_BYTES = 22
CHUNK_HEAD_BYTES = 40  # before the compressed data, less the name of the compression
BLOCK_BYTES = 1 << 20

Parsed = TypeVar("Parsed", bound=McapRecord)


class DamageError(Exception):
    """Why the bytes cannot be what they should be."""


@dataclass(frozen=True)
class RawRecord:
    """A record as it stands: `body` is shorter than `size` where the file ends before it."""

    offset: int
    opcode: int
    size: int
    body: bytes

    @property
    def is_whole(self) -> bool:
        """Tell whether the file holds all of it."""
        return len(self.body) == self.size


def raw_records(file: BinaryIO, *, only: int | None = None) -> Iterator[RawRecord]:
    """Yield the records after the magic, up to the footer or the first that is cut short.

    With `only`, those with that opcode; the others are passed over unread.
    Raises DamageError where there is no magic, or a record cannot be one.
    """
    end = file.seek(0, 2)
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        raise DamageError("does not begin as an MCAP file does")
    offset = len(MAGIC)
    while offset + HEAD_BYTES <= end:
        opcode, size = struct.unpack("<BQ", file.read(HEAD_BYTES))
        if opcode == 0 or size > LARGEST_RECORD_BYTES:
            raise DamageError(f"byte {offset}: no record begins with {opcode} and a size of {size}")
        if only not in (None, opcode, int(Opcode.FOOTER)):
            offset = file.seek(offset + HEAD_BYTES + size)
            continue
        body = file.read(min(size, end - offset - HEAD_BYTES))
        record = RawRecord(offset, opcode, size, body)
        yield record
        offset += HEAD_BYTES + size
        if opcode == Opcode.FOOTER or not record.is_whole:
            return


def parse_header(body: bytes) -> Header:
    """Return the header; DamageError where it is none."""
    return _parse(Header, body, Header.read)


def parse_schema(body: bytes) -> Schema:
    """Return a schema; DamageError where it is none."""
    return _parse(Schema, body, Schema.read)


def parse_channel(body: bytes) -> Channel:
    """Return a channel; DamageError where it is none."""
    return _parse(Channel, body, Channel.read)


def parse_message(body: bytes) -> Message:
    """Return a message; DamageError where it is none."""
    if len(body) < MESSAGE_HEAD_BYTES:
        raise DamageError("a message without a head")
    return _parse(Message, body, lambda stream: Message.read(stream, len(body)))


def parse_metadata(body: bytes) -> Metadata:
    """Return metadata; DamageError where it is none."""
    return _parse(Metadata, body, Metadata.read)


def parse_attachment(body: bytes) -> Attachment:
    """Return an attachment; DamageError where it is none or its checksum does not fit."""
    attachment = _parse(Attachment, body, Attachment.read)
    (crc,) = struct.unpack("<I", body[-4:])
    if crc not in (0, zlib.crc32(body[:-4])):
        raise DamageError("an attachment whose checksum does not fit")
    return attachment


def parse_chunk(body: bytes) -> Chunk:
    """Return a chunk, cut short or not; DamageError where even its head is."""
    if len(body) < CHUNK_HEAD_BYTES:
        raise DamageError("a chunk without a head")
    start, end, size, crc, name_size = struct.unpack("<QQQII", body[:32])
    data = 32 + name_size + 8
    if len(body) < data:
        raise DamageError("a chunk without a head")
    try:
        compression = body[32 : 32 + name_size].decode()
    except UnicodeDecodeError:
        raise DamageError("a chunk whose compression has no name") from None
    (packed,) = struct.unpack("<Q", body[data - 8 : data])
    if size > LARGEST_RECORD_BYTES or packed > LARGEST_RECORD_BYTES:
        raise DamageError(f"a chunk of {size} bytes; {LARGEST_RECORD_BYTES} are read at most")
    return Chunk(compression, body[data : data + packed], end, start, crc, size)


def unpack_chunk(chunk: Chunk) -> bytes:
    """Return the content of a whole chunk; DamageError where it or its checksum does not fit."""
    content = unpack_beginning(chunk)
    if len(content) != chunk.uncompressed_size:
        raise DamageError(f"a chunk of {len(content)} bytes instead of {chunk.uncompressed_size}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(content)):
        raise DamageError("a chunk whose checksum does not fit")
    return content


def unpack_beginning(chunk: Chunk) -> bytes:
    """Return as much of a chunk's content as can be had, never more than its head says."""
    if chunk.compression == "":
        return chunk.data[: chunk.uncompressed_size]
    if chunk.compression not in ("zstd", "lz4"):
        name = chunk.compression[:20]
        raise DamageError(f"a chunk compressed by {name!r}; only zstd and lz4 are read")
    blocks, missing = [], chunk.uncompressed_size
    for block in (_zstd_blocks if chunk.compression == "zstd" else _lz4_blocks)(chunk.data):
        blocks.append(block[:missing])
        missing -= len(blocks[-1])
        if missing == 0:
            break
    return b"".join(blocks)


def _zstd_blocks(data: bytes) -> Iterator[bytes]:
    # 128 MB is what zstd's own program accepts.
    decompressor = zstandard.ZstdDecompressor(max_window_size=1 << 27)
    try:
        with decompressor.stream_reader(data, read_across_frames=True) as stream:
            while block := stream.read(BLOCK_BYTES):
                yield block
    except (zstandard.ZstdError, MemoryError):
        return


def _lz4_blocks(data: bytes) -> Iterator[bytes]:
    try:
        decompressor = lz4.frame.LZ4FrameDecompressor()
        block = decompressor.decompress(data, BLOCK_BYTES)
        while block:
            yield block
            if decompressor.eof:
                return
            block = decompressor.decompress(b"", BLOCK_BYTES)
    except (RuntimeError, EOFError, MemoryError, ValueError):
        return


def split_chunk(content: bytes) -> Iterator[RawRecord]:
    """Yield the records of a chunk's content; the last one is cut short where the content is."""
    offset = 0
    while offset + HEAD_BYTES <= len(content):
        opcode, size = struct.unpack_from("<BQ", content, offset)
        begin = offset + HEAD_BYTES
        yield RawRecord(offset, opcode, size, content[begin : begin + size])
        offset = begin + size


def _parse(kind: type[Parsed], body: bytes, read: Callable[[ReadDataStream], Any]) -> Parsed:
    try:
        record = read(ReadDataStream(BytesIO(body)))
    except (struct.error, ValueError, McapError) as error:
        raise DamageError(f"no {kind.__name__} record ({error})") from None
    assert isinstance(record, kind)
    return record
