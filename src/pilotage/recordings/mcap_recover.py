# SPDX-License-Identifier: Apache-2.0
"""A broken MCAP file made whole: every complete message, a new index and footer."""

from __future__ import annotations

import contextlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    Header,
    McapRecord,
    Message,
    MetadataIndex,
    Schema,
)

from pilotage import __version__
from pilotage.atomic_files import GrowingFile, write_error
from pilotage.errors import InputError
from pilotage.recordings.mcap_container import MAGIC, ContainerWriter
from pilotage.recordings.mcap_records import (
    HEAD_BYTES,
    DamageError,
    RawRecord,
    parse_attachment,
    parse_channel,
    parse_chunk,
    parse_header,
    parse_message,
    parse_metadata,
    parse_schema,
    raw_records,
    split_chunk,
    unpack_beginning,
    unpack_chunk,
)
from pilotage.recordings.mcap_writer import PART_SUFFIX, check_mcap_name

END_RECORDS = (Opcode.DATA_END, Opcode.FOOTER)


@dataclass
class Recovery:
    """What was kept, messages by topic, and what was lost: bytes of records, and why."""

    out: Path
    kept: Counter[str] = field(default_factory=Counter)
    was_whole: bool = False
    lost_bytes: int = 0
    losses: list[str] = field(default_factory=list)
    start_ns: int | None = None
    end_ns: int | None = None

    def lose(self, count: int, why: str) -> None:
        """Note a loss; one without bytes is of the index alone."""
        self.lost_bytes += count
        self.losses.append(why)


def recovered_path(file: Path) -> Path:
    """Return where a repaired file goes by itself: `a.mcap` for `a.mcap.part`, else beside it."""
    if file.name.endswith(PART_SUFFIX):
        return file.with_name(file.name.removesuffix(PART_SUFFIX))
    return file.with_name(f"{file.stem}.recovered.mcap")


def recover(file: Path, out: Path | None = None) -> Recovery:
    """Write what is whole of `file` to `out`, which must not exist.

    Raises InputError where there is nothing to keep, RunError naming the file where `out` cannot
    be written; `out` appears once it is whole.
    """
    target = out or recovered_path(file)
    check_mcap_name(target)
    temporary = target.with_name(f".{target.name}.partial")
    if not file.is_file():
        raise InputError(f"{file}: is no file; name the broken recording")
    if target.exists():
        raise InputError(f"{target} exists; choose another name (-o) or remove it")
    recovery = Recovery(target)
    try:
        with file.open("rb") as stream:
            header = _read_header(stream)
            library = f"{header.library}; recovered by pilotage {__version__}"
            with GrowingFile(temporary) as written:
                container = ContainerWriter(written, library=library, profile=header.profile)
                container.start()
                _Recoverer(stream, container, recovery).run()
                container.finish()
                written.sync()
        if not recovery.kept:
            raise InputError(f"{file}: holds not one whole message; record again")
        _rename(temporary, target)
    except DamageError as error:
        raise InputError(f"{file}: {error}; nothing of it can be kept") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}); check the path") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
    return recovery


def _rename(temporary: Path, target: Path) -> None:
    try:
        temporary.rename(target)
    except OSError as error:
        raise write_error(target, error) from error


def _read_header(stream: BinaryIO) -> Header:
    record = next(raw_records(stream), None)
    if record is None or record.opcode != Opcode.HEADER or not record.is_whole:
        raise DamageError("ends before its first record")
    return parse_header(record.body)


class _Recoverer:
    """Goes through the broken file, record by record."""

    def __init__(self, stream: BinaryIO, container: ContainerWriter, recovery: Recovery) -> None:
        self._stream = stream
        self._container = container
        self._recovery = recovery
        self._size = stream.seek(0, 2)
        self._schemas: set[int] = {0}  # 0: a channel without a schema
        self._topics: dict[int, str] = {}

    def run(self) -> None:
        """Take over what is whole."""
        reached = len(MAGIC)
        ending: set[int] = set()
        try:
            for record in raw_records(self._stream):
                if ending or record.opcode in END_RECORDS:
                    # What follows the data is written anew, from what was kept.
                    ending |= {record.opcode} if record.is_whole else set()
                    reached = self._size
                    continue
                self._take(record)
                reached = record.offset + HEAD_BYTES + len(record.body)
        except DamageError as error:
            if not ending:
                self._recovery.lose(self._size - reached, str(error))
            ending = set()
        else:
            if reached < self._size:
                self._recovery.lose(self._size - reached, f"byte {reached}: a record's beginning")
        ends_well = Opcode.FOOTER in ending and self._has_magic()
        if not ends_well and not self._recovery.losses:
            self._recovery.lose(0, "the index, which is made anew")
        self._recovery.was_whole = ends_well and not self._recovery.losses

    def _has_magic(self) -> bool:
        self._stream.seek(-len(MAGIC), 2)
        return self._stream.read() == MAGIC

    def _take(self, record: RawRecord) -> None:
        try:
            if record.opcode == Opcode.CHUNK:
                self._take_chunk(record)
            elif not record.is_whole:
                raise DamageError("a record cut short")
            elif record.opcode in (Opcode.ATTACHMENT, Opcode.METADATA):
                self._container.copy_record(record.body, _index_of(record))
            else:
                parsed = self._parse(record)
                if parsed is not None and not self._add(parsed):
                    raise DamageError("a record of a channel or schema that is not told")
        except DamageError as error:
            self._recovery.lose(len(record.body), f"byte {record.offset}: {error}")

    def _take_chunk(self, record: RawRecord) -> None:
        """Copy a whole chunk as it is; of one that was cut short, or holds what cannot be kept,
        put the whole messages into a new one.
        """
        chunk = parse_chunk(record.body)
        content = unpack_beginning(chunk)
        if record.is_whole or len(content) == chunk.uncompressed_size:
            content = unpack_chunk(chunk)  # with its checksum
        inner = [found for found in split_chunk(content) if found.is_whole]
        parsed = [(found.offset, self._parse(found)) for found in inner]
        known = [(offset, found) for offset, found in parsed if found is not None]
        end = inner[-1].offset + HEAD_BYTES + inner[-1].size if inner else 0
        is_sound = record.is_whole and end == chunk.uncompressed_size
        if is_sound and self._all_known(known):
            for _, found in known:
                self._note(found)
            self._container.copy_chunk(record.body, chunk, known)
            return
        before = self._recovery.kept.total()
        dropped = sum(not self._add(found) for _, found in known)
        self._container.flush()
        kept = self._recovery.kept.total() - before
        what = f"{dropped} of its records of no known channel" if dropped else "cut short"
        lost = chunk.uncompressed_size - end
        self._recovery.lose(
            lost, f"byte {record.offset}: a chunk, {what}, {kept} of its messages kept"
        )

    def _parse(self, record: RawRecord) -> McapRecord | None:
        """Return a schema, channel or message; None for what is written anew."""
        if record.opcode == Opcode.SCHEMA:
            return parse_schema(record.body)
        if record.opcode == Opcode.CHANNEL:
            return parse_channel(record.body)
        return parse_message(record.body) if record.opcode == Opcode.MESSAGE else None

    def _all_known(self, parsed: list[tuple[int, McapRecord]]) -> bool:
        schemas, channels = set(self._schemas), set(self._topics)
        for _, record in parsed:
            if isinstance(record, Schema):
                schemas.add(record.id)
            elif isinstance(record, Channel):
                if record.schema_id not in schemas:
                    return False
                channels.add(record.id)
            elif isinstance(record, Message) and record.channel_id not in channels:
                return False
        return True

    def _add(self, record: McapRecord) -> bool:
        """Write a record; False where its channel or schema is not known."""
        if not self._all_known([(0, record)]):
            return False
        self._note(record)
        if isinstance(record, Schema):
            self._container.add_schema(record)
        elif isinstance(record, Channel):
            self._container.add_channel(record)
        elif isinstance(record, Message):
            self._container.add_message(record)
        return True

    def _note(self, record: McapRecord) -> None:
        recovery = self._recovery
        if isinstance(record, Schema):
            self._schemas.add(record.id)
        elif isinstance(record, Channel):
            self._topics[record.id] = record.topic
        elif isinstance(record, Message):
            recovery.kept[self._topics[record.channel_id]] += 1
            time_ns = record.log_time
            earliest_ns = time_ns if recovery.start_ns is None else recovery.start_ns
            recovery.start_ns = min(earliest_ns, time_ns)
            recovery.end_ns = max(recovery.end_ns or 0, time_ns)


def _index_of(record: RawRecord) -> AttachmentIndex | MetadataIndex:
    """Return the index of an attachment or metadata record, its place not filled in."""
    if record.opcode == Opcode.METADATA:
        return MetadataIndex(offset=0, length=0, name=parse_metadata(record.body).name)
    attachment = parse_attachment(record.body)
    return AttachmentIndex(
        offset=0, length=0, log_time=attachment.log_time, create_time=attachment.create_time,
        data_size=len(attachment.data), name=attachment.name, media_type=attachment.media_type,
    )  # fmt: skip
