# SPDX-License-Identifier: Apache-2.0
"""The stereo pairs of an MCAP file by name, and which of their pictures belong together."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pilotage.calibration.rig_calibration import FORWARD_WORDS
from pilotage.errors import InputError
from pilotage.recordings import ros_messages as ros
from pilotage.recordings.mcap_index import Topic
from pilotage.recordings.mcap_writer import LEFT, RIGHT
from pilotage.recordings.recording import NAMELESS

# Cameras of a pair fire together; a small offset is the clock's, a larger one another picture.
PAIR_TOLERANCE_NS = 2_000_000
PICTURE_TOPIC = re.compile(r"(?P<camera>/.+?)/image(_raw|_mono|_color)?(?P<packed>/compressed)?")
# How the names of a left and a right camera end.
SIDE_WORDS = (("left", "right"), ("cam0", "cam1"), ("infra1", "infra2"))
INFO = "/camera_info"
NO_PARTNER = -1


class Cameras(NamedTuple):
    """Where the pictures of a pair are, and what its cameras are called: `/front_left`."""

    left: str
    right: str
    left_topic: Topic
    right_topic: Topic


def picture_topics(topics: Mapping[str, Topic]) -> dict[str, Topic]:
    """Return the topic with the pictures of each camera, by the camera's name: `/front_left`."""
    pictures: dict[str, Topic] = {}
    for name in sorted(topics):  # a camera's plain pictures come before its compressed ones
        match = PICTURE_TOPIC.fullmatch(name)
        wanted = ros.IMAGE if match and not match["packed"] else ros.COMPRESSED_IMAGE
        if match and topics[name].type_name == wanted and topics[name].times_ns:
            pictures.setdefault(match["camera"], topics[name])
    return pictures


def find_pairs(topics: Mapping[str, Topic]) -> dict[str, Cameras]:
    """Return the stereo pairs by name: `front` of `/front_left` and `/front_right`."""
    pictures, pairs = picture_topics(topics), {}
    for camera in pictures:
        for left, right in SIDE_WORDS:
            partner = camera.removesuffix(left) + right
            if not camera.endswith(left) or partner not in pictures:
                continue
            # Ours are a pair by name alone; of others', two of other times are none.
            is_ours = (camera, partner) == (f"/{LEFT}", f"/{RIGHT}")
            if is_ours or _have_common_time(pictures[camera], pictures[partner]):
                name = camera.removesuffix(left).strip("/_-.") or NAMELESS
                name = name if name not in pairs else camera.strip("/")
                pairs[name] = Cameras(camera, partner, pictures[camera], pictures[partner])
    return pairs


def silent_pairs(topics: Mapping[str, Topic]) -> dict[str, str]:
    """Return the stereo pairs that are calibrated but cannot be one, by name, and why."""
    pictures, pairs = picture_topics(topics), find_pairs(topics)
    told = {name.removesuffix(INFO) for name in topics if name.endswith(INFO)} | set(pictures)
    silent: dict[str, str] = {}
    for left_camera in sorted(told):
        for left, right in SIDE_WORDS:
            partner = left_camera.removesuffix(left) + right
            name = left_camera.removesuffix(left).strip("/_-.") or NAMELESS
            if not left_camera.endswith(left) or partner not in told or name in pairs:
                continue
            missing = [camera for camera in (left_camera, partner) if camera not in pictures]
            silent[name] = (
                f"holds no picture of {' and '.join(missing)}; look at the camera and its cable"
                if missing
                else f"the times of {left_camera} and {partner} have nothing in common"
            )
    return silent


def choose_pair(
    topics: Mapping[str, Topic], wanted: str | None, file: Path, *, may_guess: bool = False
) -> str:
    """Return the name of the wanted pair; without a wish the only one, or the one looking ahead.

    Where none is said to look ahead, `may_guess` takes the first. InputError lists the pairs there
    are, or the cameras where there is no pair.
    """
    pairs = find_pairs(topics)
    if not pairs:
        found = ", ".join(picture_topics(topics)) or "none"
        raise InputError(
            f"{file}: holds 0 stereo pairs, one is needed: cameras named /{LEFT} and /{RIGHT}, or "
            f"two that end in left and right; with pictures are: {found}. Single pictures are read "
            "by pilotage.recordings.open_pictures"
        )
    names = ", ".join(pairs)
    if wanted is not None:
        if wanted not in pairs:
            raise InputError(f"{file}: holds no stereo pair {wanted!r}; there are: {names}")
        return wanted
    forward = [name for word in FORWARD_WORDS for name in pairs if name.startswith(word)]
    if not forward and len(pairs) > 1 and not may_guess:
        raise InputError(
            f"{file}: holds {len(pairs)} stereo pairs ({names}), and none is called front; "
            "choose one (--pair)"
        )
    return forward[0] if forward else next(iter(pairs))


def match_pictures(cameras: Cameras, file: Path) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the left pictures in order of time, each time once, and the right one of each.

    A left picture without partner has `NO_PARTNER`; InputError where none has one.
    """
    left_ns, lefts = np.unique(np.array(cameras.left_topic.times_ns, np.int64), return_index=True)
    right_ns, rights = np.unique(
        np.array(cameras.right_topic.times_ns, np.int64), return_index=True
    )
    after = np.clip(np.searchsorted(right_ns, left_ns), 0, len(right_ns) - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(right_ns[before] - left_ns) < np.abs(right_ns[after] - left_ns)
    nearest = np.where(is_before, before, after)
    is_near = np.abs(right_ns[nearest] - left_ns) <= PAIR_TOLERANCE_NS
    if not is_near.any():
        raise InputError(
            f"{file}: none of {len(lefts)} left and {len(rights)} right pictures are of the same "
            f"time; left starts at {left_ns[0]} ns, right at {right_ns[0]} ns"
        )
    return lefts, np.where(is_near, rights[nearest], NO_PARTNER)


def _have_common_time(left: Topic, right: Topic) -> bool:
    return bool(min(left.times_ns) <= max(right.times_ns)) and bool(
        min(right.times_ns) <= max(left.times_ns)
    )
