# SPDX-License-Identifier: Apache-2.0
"""What the judge of several stereo pairs decided, in words a user understands.

`words_of` makes them of a history of `JointResult`s and nothing else; `tell` and `words` do the
same one result at a time, for long runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

from pilotage.reasons import short_words

if TYPE_CHECKING:
    from pilotage import JointResult, JudgeConfig, PairVerdict

# A turn that moves a point this far away by as much as the shift counts as much as the shift.
ARM_M = 1.0


@dataclass(frozen=True)
class PairState:
    """What one pair says; `since_ns` is when its `belief` became what it is.

    `along_axis_m` is what it is apart along the axis where that is most. `has_contradicted` tells
    whether since then it moved otherwise than the others; by the paper's rule, whether it does now.
    """

    belief: str
    status: str
    reason: str
    since_ns: int
    apart_m: float
    along_axis_m: float
    turned_rad: float
    chi_square: float
    has_contradicted: bool = False


@dataclass(frozen=True)
class Story:
    """How things stand at an instant, as far as it takes to tell of it."""

    timestamp_ns: int
    status: str
    pairs: tuple[PairState, ...]

    @property
    def must_stop(self) -> bool:
        """Tell whether nothing is known of where the robot is: it is to stop."""
        return self.status == "lost"

    @property
    def believed(self) -> tuple[int, ...]:
        """Return which pairs are believed, by their numbers."""
        return tuple(i for i, pair in enumerate(self.pairs) if pair.belief == "joined")

    @property
    def is_disputed(self) -> bool:
        """Tell whether a pair is set aside that moved otherwise than those believed."""
        return any(pair.belief == "disagrees" and pair.has_contradicted for pair in self.pairs)


def tell(before: Story | None, result: JointResult, config: JudgeConfig) -> Story:
    """Return how things stand after `result`, given how they stood; neither is changed."""
    states = []
    for number, verdict in enumerate(result.pairs):
        earlier = before.pairs[number] if before else None
        is_same = earlier is not None and earlier.belief == verdict.belief.name
        since_ns = earlier.since_ns if earlier and is_same else result.timestamp_ns
        state = _state(verdict, since_ns)
        contradicts = state.belief == "disagrees" and not _agrees(state, config)
        # The paper's rule watches nobody: what is not chosen contradicts only while it differs.
        is_watched = is_same and config.rule != "paper"
        kept = bool(earlier and is_watched and earlier.has_contradicted)
        states.append(replace(state, has_contradicted=contradicts or kept))
    return Story(result.timestamp_ns, result.status.name, tuple(states))


def _state(verdict: PairVerdict, since_ns: int) -> PairState:
    difference = [float(value) for value in verdict.difference]
    return PairState(
        belief=verdict.belief.name,
        status=verdict.status.name,
        reason=verdict.reason.name,
        since_ns=since_ns,
        apart_m=math.hypot(*difference[:3]),
        along_axis_m=max(map(abs, difference[:3])),
        turned_rad=math.hypot(*difference[3:]),
        chi_square=float(verdict.chi_square),
    )


def words_of(history: Iterable[JointResult], names: Sequence[str], config: JudgeConfig) -> str:
    """Return in one line how things stand at the end of `history`; empty for an empty one.

    `names` are those of the pairs, `config` is the judge's.
    """
    story: Story | None = None
    for result in history:
        story = tell(story, result, config)
    return "" if story is None else words(story, names, config)


def words(story: Story, names: Sequence[str], config: JudgeConfig) -> str:
    """Return how things stand: "front: too few points for 0.8 s; using down"."""
    if story.must_stop:
        return f"{_all_lost(story, names)}: stop"
    using = _listed([names[number] for number in story.believed])
    told = [
        _doubt(story, number, names, config)
        for number, pair in enumerate(story.pairs)
        if pair.belief != "joined"
    ]
    told += [
        f"{name}: uncertain, {short_words(pair.reason)}"
        for name, pair in zip(names, story.pairs, strict=True)
        if pair.belief == "joined" and pair.status == "degraded" and pair.reason != "none"
    ]
    return "; ".join([*told, f"using {using}"])


def _doubt(story: Story, number: int, names: Sequence[str], config: JudgeConfig) -> str:
    """Return why a pair is not believed."""
    pair, name = story.pairs[number], names[number]
    for_s = f"for {(story.timestamp_ns - pair.since_ns) * 1e-9:.1f} s"
    if pair.belief == "absent":
        return f"{name}: no pictures {for_s}"
    if pair.belief == "lost":
        return f"{name}: {short_words(pair.reason) if pair.reason != 'none' else 'lost'} {for_s}"
    others = _listed([names[other] for other in story.believed])
    if not pair.has_contradicted:
        if pair.chi_square == 0:
            return f"{name}: back, not compared with {others} yet"
        aside = "not chosen" if config.rule == "paper" else f"watched {for_s}"
        return f"{name}: agrees with {others}, {aside}"
    if _agrees(pair, config):
        return f"{name}: set aside {for_s}, agrees with {others} just now"
    return f"{name} and {others} differ by {_difference(pair)} in {_span(config)}"


def _agrees(pair: PairState, config: JudgeConfig) -> bool:
    """Tell whether what is set aside would pass: it waits to be believed again."""
    if config.rule == "paper":
        return pair.along_axis_m <= float(str(config.paper_limit_m))
    return pair.chi_square < chi_square_limit(config.confidence)


@lru_cache
def chi_square_limit(confidence: float) -> float:
    """Return what the difference of two sound motions stays below with that probability."""
    from scipy.special import chdtri

    return float(chdtri(6, 1 - confidence))


def _difference(pair: PairState) -> str:
    if pair.turned_rad * ARM_M > pair.apart_m:
        return f"{math.degrees(pair.turned_rad):.2g} deg"
    return f"{1e3 * pair.apart_m:.2g} mm" if pair.apart_m < 0.1 else f"{pair.apart_m:.2g} m"


def _span(config: JudgeConfig) -> str:
    return f"{config.window_s:.1f} s"


def _all_lost(story: Story, names: Sequence[str]) -> str:
    """Return that nobody has a pose, and why each has none."""
    count = {1: names[0], 2: "both"}.get(len(names), "all")
    whys = []
    for name, pair in zip(names, story.pairs, strict=True):
        why = "no pictures" if pair.belief == "absent" else short_words(pair.reason)
        if pair.reason != "none" or pair.belief == "absent":
            whys.append(why if len(names) == 1 else f"{name}: {why}")
    return f"{count} lost" + (f" ({', '.join(whys)})" if whys else "")


def _listed(names: Sequence[str]) -> str:
    """Return "front", "front and down", "front, left and down"."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


@dataclass(frozen=True)
class Happening:
    """A stretch of time in which the same pairs were believed, and why not the others."""

    start_ns: int
    end_ns: int
    words: str
    must_stop: bool


def happenings(
    history: Iterable[JointResult], names: Sequence[str], config: JudgeConfig
) -> list[Happening]:
    """Return the stretches in which a pair was not believed.

    They are told as they stood at their ends, with the largest difference on the way.
    """
    found: list[Happening] = []
    story: Story | None = None
    start_ns = 0
    key: tuple[tuple[int, str, str], ...] = ()
    for result in history:
        now = tell(story, result, config)
        now_key = tuple(
            (number, pair.belief, pair.reason)
            for number, pair in enumerate(now.pairs)
            if pair.belief != "joined" and not _is_spare(pair, config)
        )
        if story is not None and now_key != key and key:
            found.append(_ended(story, start_ns, names, config))
        if story is None or now_key != key:
            start_ns, key = now.timestamp_ns, now_key
        else:
            now = replace(now, pairs=tuple(map(_worse, story.pairs, now.pairs)))
        story = now
    return [*found, _ended(story, start_ns, names, config)] if story and key else found


def _ended(story: Story, start_ns: int, names: Sequence[str], config: JudgeConfig) -> Happening:
    told = words(story, names, config)
    return Happening(start_ns, story.timestamp_ns, told, story.must_stop)


def _worse(before: PairState, now: PairState) -> PairState:
    """Return `now` with the larger of both differences: of a stretch that one counts."""
    if before.belief != now.belief or before.chi_square <= now.chi_square:
        return now
    return replace(
        now,
        apart_m=before.apart_m,
        along_axis_m=before.along_axis_m,
        turned_rad=before.turned_rad,
        chi_square=before.chi_square,
    )


def _is_spare(pair: PairState, config: JudgeConfig) -> bool:
    """Tell whether a pair is only not the chosen one, as is always one by the paper's rule."""
    return config.rule == "paper" and pair.belief == "disagrees" and not pair.has_contradicted
