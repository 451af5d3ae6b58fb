# SPDX-License-Identifier: Apache-2.0
# Long: cuts, flipped bits, kills and full disks share their recordings.
"""Recordings cut off anywhere are made whole; broken ones are told in the project's own words."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from full_disk import file_size_limit
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer
from program import call
from test_mcap import foreign_bag, make_rig, write_recording

from pilotage.errors import InputError, RunError
from pilotage.recordings import mcap_container, open_recording
from pilotage.recordings.mcap_records import parse_chunk, raw_records, split_chunk, unpack_chunk
from pilotage.recordings.mcap_recover import Recovery, recover
from pilotage.recordings.mcap_writer import McapWriter

Content = list[tuple[str, int, bytes]]


def messages(file: Path) -> Content:
    """Return topic, time and data of all messages, as another reader sees them."""
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        found = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(found)
    return found


def chunks_of(file: Path) -> list[tuple[int, int]]:
    """Return where each chunk ends, and the number of its messages."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        ends = {c.chunk_start_offset + c.chunk_length: 0 for c in summary.chunk_indexes}
        for record in raw_records(stream):
            if record.opcode == Opcode.CHUNK:
                inner = split_chunk(unpack_chunk(parse_chunk(record.body)))
                end = record.offset + 9 + record.size
                ends[end] = sum(found.opcode == Opcode.MESSAGE for found in inner)
    return list(ends.items())


@pytest.fixture(autouse=True)
def _no_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", lambda _: None)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of several chunks, packed and plain ones."""
    file = tmp_path_factory.mktemp("whole") / "a.mcap"
    write_recording(file, make_rig(0), 50)
    return file


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small bag of another tool, a single packed chunk."""
    file = tmp_path_factory.mktemp("packed") / "a.mcap"
    foreign_bag(file)
    return file


def recovered(data: bytes, folder: Path) -> tuple[Content, Recovery] | None:
    """Return what is recovered of `data`, None where nothing can be."""
    file, out = folder / "cut.mcap", folder / "out.mcap"
    file.write_bytes(data)
    out.unlink(missing_ok=True)
    try:
        recovery = recover(file, out)
    except InputError:
        assert {path.name for path in folder.iterdir()} == {"cut.mcap"}
        return None
    found = messages(out)
    assert recovery.kept.total() == len(found)
    return found, recovery


def test_every_complete_message_outlives_a_cut(whole: Path, tmp_path: Path) -> None:
    data, everything = whole.read_bytes(), messages(whole)
    rng = np.random.default_rng(0)
    places = [*range(0, len(data), len(data) // 60), *rng.integers(0, len(data), 40).tolist()]
    chunks, kept_before = chunks_of(whole), 0
    for place in sorted({*places, *range(60), *range(len(data) - 60, len(data))}):
        result = recovered(data[:place], tmp_path)
        kept = [] if result is None else result[0]
        assert kept == everything[: len(kept)]
        assert len(kept) >= kept_before
        kept_before = len(kept)
        assert len(kept) >= sum(count for end, count in chunks if end <= place)
    assert kept_before == len(everything)


@pytest.mark.parametrize("step", [11])
def test_bags_of_other_tools_cut_at_every_kth_byte(step: int, packed: Path, tmp_path: Path) -> None:
    data, everything = packed.read_bytes(), messages(packed)
    counts = []
    for place in range(0, len(data), step):
        result = recovered(data[:place], tmp_path)
        kept = [] if result is None else result[0]
        assert set(kept) <= set(everything)
        counts.append(len(kept))
    assert counts == sorted(counts)


def test_plain_chunks_give_all_but_the_last_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_container, "WORTH_COMPRESSING", 0)
    rng = np.random.default_rng(0)
    with McapWriter(tmp_path / "a.mcap", pictures="raw") as writer:
        writer.add_rig(make_rig(0), timestamp_ns=0)
        for i in range(8):
            noise = rng.integers(0, 255, (2, 48, 64), np.uint8)
            writer.write_pair(timestamp_ns=i, left=noise[0], right=noise[1])
    data, everything = (tmp_path / "a.mcap").read_bytes(), messages(tmp_path / "a.mcap")
    (tmp_path / "a.mcap").unlink()
    ends = [data.find(message[2]) + len(message[2]) for message in everything]
    for place in rng.integers(0, len(data), 60).tolist():
        result = recovered(data[:place], tmp_path)
        assert (0 if result is None else len(result[0])) == sum(end <= place for end in ends)


def test_a_recovered_recording_is_one(whole: Path, tmp_path: Path) -> None:
    data = whole.read_bytes()
    assert recovered(data[: len(data) * 2 // 3], tmp_path) is not None
    again, first = open_recording(tmp_path / "out.mcap"), open_recording(whole)
    assert 20 <= len(again) < len(first) == 50
    assert (
        again.rig.right_from_left.matrix().tolist() == first.rig.right_from_left.matrix().tolist()
    )
    truth, first_truth = again.truth(), first.truth()
    assert truth is not None
    assert first_truth is not None
    count = len(truth.timestamps_ns)
    np.testing.assert_array_equal(truth.world_from_left, first_truth.world_from_left[:count])


def test_a_chunk_with_a_flipped_bit_is_left_out(whole: Path, tmp_path: Path) -> None:
    data, everything = bytearray(whole.read_bytes()), messages(whole)
    with whole.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[1]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 16
    (tmp_path / "broken.mcap").write_bytes(data)
    with pytest.raises(InputError, match=r"broken\.mcap: .*checksum.*pilotage recover"):
        open_recording(tmp_path / "broken.mcap")
    (tmp_path / "broken.mcap").unlink()
    result = recovered(bytes(data), tmp_path)
    assert result is not None
    kept, recovery = result
    assert set(kept) < set(everything)
    assert len(recovery.losses) == 1
    assert f"byte {chunk.chunk_start_offset}" in recovery.losses[0]
    assert "checksum" in recovery.losses[0]


def test_attachments_and_metadata_stay(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream, chunk_size=1)
        writer.start(profile="ros2", library="another tool")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("a", "ros2msg", b""))
        writer.add_message(channel, 5, b"message", 5)
        writer.add_attachment(1, 2, "notes.txt", "text/plain", b"Monday")
        writer.add_metadata("robot", {"name": "rover"})
        writer.add_message(channel, 6, b"last one", 6)
        writer.finish()
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").unlink()
    result = recovered(data[: data.find(b"rover") + 5 + 40], tmp_path)
    assert result is not None
    assert result[0] == [("/a", 5, b"message")]
    with (tmp_path / "out.mcap").open("rb") as stream:
        reader = make_reader(stream)
        assert [(a.name, a.data) for a in reader.iter_attachments()] == [("notes.txt", b"Monday")]
        assert [m.metadata for m in reader.iter_metadata()] == [{"name": "rover"}]
        assert reader.get_header().library.startswith("another tool; recovered by pilotage")


def test_recovering_again_changes_nothing(whole: Path, tmp_path: Path) -> None:
    result = recovered(whole.read_bytes(), tmp_path)
    assert result is not None
    assert result[1].was_whole
    assert result[0] == messages(whole)


@pytest.mark.parametrize("seed", range(6))
def test_broken_bytes_never_crash(seed: int, whole: Path, packed: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    for number in range(25):
        data = bytearray((whole if seed % 3 == 0 else packed).read_bytes())
        for _ in range(rng.integers(1, 6)):
            # Heads and tails are where the structure is.
            place = int(rng.integers(0, rng.choice([50, 400, 4000, len(data)])))
            place = place if number % 2 else len(data) - 1 - place
            data[place] = int(rng.choice([0, 1, 127, 128, 255, rng.integers(0, 256)]))
        with contextlib.suppress(InputError):
            recovered(bytes(data), tmp_path)
        with contextlib.suppress(InputError):
            recording = open_recording(tmp_path / "cut.mcap")
            assert sum(1 for _ in recording.frames()) == len(recording)
            recording.truth()


@pytest.mark.parametrize("seed", range(4))
def test_broken_messages_never_crash(seed: int, tmp_path: Path, monkeypatch) -> None:
    """Bytes inside messages, whose checksums are right: the fault of another writer."""
    rng = np.random.default_rng(seed)
    for number in range(15):
        (tmp_path / "a.mcap").unlink(missing_ok=True)
        with monkeypatch.context() as patch:
            patch.setattr(McapWriter, "_write", _spoiling(McapWriter._write, rng))
            write_recording(tmp_path / "a.mcap", make_rig(number), 3)
        with contextlib.suppress(InputError):
            recording = open_recording(tmp_path / "a.mcap")
            assert sum(1 for _ in recording.frames()) == len(recording)
            recording.truth()


def _spoiling(write, rng):
    def spoil(self, topic, type_name, timestamp_ns, data, **metadata):
        changed = bytearray(data)
        if rng.random() < 0.3:
            for _ in range(rng.integers(1, 4)):
                place = int(rng.integers(0, rng.choice([20, 80, len(data)])))
                changed[place % len(data)] = int(rng.choice([0, 127, 255, rng.integers(0, 256)]))
        cut = int(rng.integers(0, len(data))) if rng.random() < 0.05 else len(data)
        write(self, topic, type_name, timestamp_ns, bytes(changed[:cut]), **metadata)

    return spoil


def test_the_verb(whole: Path, tmp_path: Path) -> None:
    part = tmp_path / "monday.mcap.part"
    part.write_bytes(whole.read_bytes()[:-10_000])
    done = call("recover", part)
    assert done.exit_code == 0
    assert "Kept" in done.stdout
    assert "/truth/pose: " in done.stdout
    assert "lost" in done.stderr
    assert len(open_recording(tmp_path / "monday.mcap")) > 30
    again = call("recover", part)
    assert again.exit_code == 2
    assert "monday.mcap exists" in again.stderr
    assert call("recover", part, "-o", tmp_path / "b.mcap").exit_code == 0
    assert call("recover", tmp_path / "b.mcap").exit_code == 0
    assert (tmp_path / "b.recovered.mcap").exists()
    for name, word in (("absent.mcap", "is no file"), ("empty.mcap", "MCAP")):
        (tmp_path / "empty.mcap").write_bytes(b"")
        failed = call("recover", tmp_path / name)
        assert failed.exit_code == 2
        assert word in failed.stderr
    assert call("recover", part, "-o", tmp_path / "c.bag").exit_code == 2


def test_a_killed_recorder_loses_a_second_at_most(tmp_path: Path) -> None:
    code = (
        "import sys, time\nfrom pathlib import Path\n"
        "from test_mcap import make_pairs, make_rig\n"
        "from pilotage.recordings.mcap_writer import McapWriter\n"
        "(left, right), = make_pairs(1)\n"
        "with McapWriter(Path(sys.argv[1])) as writer:\n"
        "    writer.add_rig(make_rig(0), timestamp_ns=0)\n"
        "    for i in range(101):\n"
        "        writer.write_pair(timestamp_ns=i * 50_000_000, left=left, right=right)\n"
        "    print('ready', flush=True)\n    time.sleep(60)\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "a.mcap")]
    here = str(Path(__file__).parent)
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, [here, os.environ.get("PYTHONPATH")])),
    }
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as recorder:
        assert recorder.stdout is not None
        assert recorder.stdout.readline() == b"ready\n"
        recorder.send_signal(signal.SIGKILL)
    assert [file.name for file in tmp_path.iterdir()] == ["a.mcap.part"]
    recover(tmp_path / "a.mcap.part")
    frames = list(open_recording(tmp_path / "a.mcap").frames())
    assert frames[-1].timestamp_ns >= 4_000_000_000


def test_a_full_disk_keeps_what_fitted(tmp_path: Path) -> None:
    with file_size_limit(300_000):
        with pytest.raises(RunError, match=r"cannot write .*a\.mcap\.part"):
            write_recording(tmp_path / "a.mcap", make_rig(0), 80)
        with pytest.raises(InputError, match="pilotage recover"):
            open_recording(tmp_path / "a.mcap.part")
    recovery = recover(tmp_path / "a.mcap.part")
    assert recovery.losses == ["the index, which is made anew"]
    assert len(open_recording(tmp_path / "a.mcap")) >= 20


def test_a_full_disk_while_recovering(whole: Path, tmp_path: Path) -> None:
    with file_size_limit(100_000):
        failed = call("recover", whole, "-o", tmp_path / "a.mcap")
    assert failed.exit_code == 2
    assert re.search(r"a\.mcap.*choose another place with -o", failed.stderr)
    assert list(tmp_path.iterdir()) == []
