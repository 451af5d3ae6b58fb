# SPDX-License-Identifier: Apache-2.0
"""What a person sees on the terminal while a run goes on."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from pathlib import Path

from synthetic import SyntheticRecording

PROGRAM = [sys.executable, "-m", "pilotage.cli.main"]


def seen_on_a_terminal(command: list[str]) -> tuple[int, str]:
    """Return the exit code and all that was written to a terminal as stderr."""
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "120"}
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=theirs, env=environment
    ) as process:
        os.close(theirs)
        text = b""
        while True:
            try:
                chunk = os.read(ours, 4096)
            except OSError:  # the other end is closed: how Linux ends a pseudo-terminal
                break
            if not chunk:
                break
            text += chunk
    os.close(ours)
    return process.returncode, text.decode()


def test_a_terminal_shows_a_bar_to_the_last_pair(
    synthetic_kitti: SyntheticRecording, tmp_path: Path
):
    code, text = seen_on_a_terminal(
        [*PROGRAM, "localize", str(synthetic_kitti.path), "-o", str(tmp_path / "out")]
    )
    assert code == 0, text
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)
    assert "20/20" in plain
    assert re.search(r"[\d.]+ pairs/s", plain)
    assert re.search(r"tracking, \d+ inliers", plain)
    assert "━" in plain


def test_a_terminal_tells_below_the_bar_whom_it_believes(yard_pairs: Path, tmp_path: Path):
    command = [*PROGRAM, "localize", str(yard_pairs), "-o", str(tmp_path / "out"), "--no-report"]
    code, text = seen_on_a_terminal(command)
    assert code == 0, text
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)
    assert re.search(r"[\r\n]([^━\r\n]*; )?using (front|down)", plain)
    assert "━" in plain


def test_a_pipe_gets_lines_without_control_characters(
    synthetic_kitti: SyntheticRecording, tmp_path: Path
):
    command = [*PROGRAM, "localize", str(synthetic_kitti.path), "-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "\x1b" not in done.stderr
    assert re.search(r"20/20 pairs, [\d.]+ pairs/s, tracking, \d+ inliers", done.stderr)
