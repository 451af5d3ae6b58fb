# SPDX-License-Identifier: Apache-2.0
"""The words that tell of the judge's decisions: a pure function of their history."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from pilotage import Belief, JudgeConfig, Reason, Status
from pilotage.judge_words import happenings, tell, words_of
from pilotage.reasons import REASONS, reason_words, short_words

NAMES = ("front", "down")
CONFIG = JudgeConfig()
PAPER = JudgeConfig.from_dict({"rule": "paper"})


def verdict(
    belief: str = "joined",
    reason: str = "none",
    *,
    difference: Sequence[float] = (0.0,) * 6,
    chi_square: float = 0.0,
) -> Any:
    status = "tracking" if belief in {"joined", "disagrees"} else "lost"
    return SimpleNamespace(
        belief=Belief[belief],
        status=Status["degraded" if belief == "joined" and reason != "none" else status],
        reason=Reason[reason],
        difference=list(difference),
        chi_square=chi_square,
    )


def at(seconds: float, *pairs: Any) -> Any:
    believed = any(pair.belief is Belief.joined for pair in pairs)
    return SimpleNamespace(
        timestamp_ns=round(seconds * 1e9),
        status=Status.tracking if believed else Status.lost,
        pairs=list(pairs),
    )


def test_all_believed():
    assert words_of([at(0, verdict(), verdict())], NAMES, CONFIG) == "using front and down"
    three = [at(0, verdict(), verdict(), verdict())]
    assert words_of(three, ("front", "left", "down"), CONFIG) == "using front, left and down"
    assert words_of([], NAMES, CONFIG) == ""


def test_a_lost_pair_is_told_with_its_time():
    dark = verdict("lost", "too_few_points")
    history = [at(0, verdict(), verdict()), at(1.0, dark, verdict()), at(1.8, dark, verdict())]
    assert words_of(history, NAMES, CONFIG) == "front: too few points for 0.8 s; using down"
    # Another reason on the way does not begin the time anew.
    blurred = [*history, at(2.0, verdict("lost", "blurred"), verdict())]
    assert words_of(blurred, NAMES, CONFIG) == "front: blurred for 1.0 s; using down"


def test_a_pair_without_pictures():
    history = [at(0, verdict(), verdict()), at(1, verdict(), verdict("absent"))]
    assert words_of(history, NAMES, CONFIG) == "down: no pictures for 0.0 s; using front"


def test_a_difference_is_told_in_millimetres():
    apart = verdict("disagrees", difference=(0.012, 0, 0, 0, 0, 0), chi_square=500)
    told = words_of([at(0, apart, verdict())], NAMES, CONFIG)
    assert told == "front and down differ by 12 mm in 1.0 s; using down"


def test_a_turn_is_told_in_degrees():
    apart = verdict("disagrees", difference=(0.001, 0, 0, 0, 0.0349, 0), chi_square=500)
    told = words_of([at(0, verdict(), apart)], NAMES, CONFIG)
    assert told == "down and front differ by 2 deg in 1.0 s; using front"


def test_who_comes_back_is_watched():
    apart = verdict("disagrees", difference=(0.012, 0, 0, 0, 0, 0), chi_square=500)
    close = verdict("disagrees", difference=(0.001, 0, 0, 0, 0, 0), chi_square=5)
    new = verdict("disagrees")
    told = words_of([at(0, new, verdict())], NAMES, CONFIG)
    assert told == "front: back, not compared with down yet; using down"
    told = words_of([at(0, new, verdict()), at(0.6, close, verdict())], NAMES, CONFIG)
    assert told == "front: agrees with down, watched for 0.6 s; using down"
    told = words_of([at(0, apart, verdict()), at(2, close, verdict())], NAMES, CONFIG)
    assert told == "front: set aside for 2.0 s, agrees with down just now; using down"


def test_when_nobody_is_believed_the_robot_is_to_stop():
    dark = verdict("lost", "too_dark")
    history = [at(0, verdict(), verdict()), at(1, dark, verdict("absent"))]
    told = words_of(history, NAMES, CONFIG)
    assert told == "both lost (front: too dark, down: no pictures): stop"
    assert tell(None, history[-1], CONFIG).must_stop
    three = words_of([at(1, dark, dark, dark)], ("a", "b", "c"), CONFIG)
    assert three.startswith("all lost (")
    assert words_of([at(1, dark)], ("front",), CONFIG) == "front lost (too dark): stop"


def test_an_uncertain_pair_that_is_believed():
    told = words_of([at(0, verdict(reason="ambiguous"), verdict())], NAMES, CONFIG)
    assert told == "front: uncertain, repeating pattern; using front and down"


def test_the_papers_choice_is_no_dispute():
    near = verdict("disagrees", difference=(0.002, 0, 0, 0, 0, 0), chi_square=100)
    far = verdict("disagrees", difference=(0.2, 0, 0, 0, 0, 0), chi_square=100)
    spare, chosen = at(0, verdict(), near), at(1, verdict(), far)
    assert words_of([spare], NAMES, PAPER) == "down: agrees with front, not chosen; using front"
    assert not tell(None, spare, PAPER).is_disputed
    assert tell(None, chosen, PAPER).is_disputed
    assert happenings([spare], NAMES, PAPER) == []
    assert "differ by 0.2 m" in words_of([chosen], NAMES, PAPER)
    # The limit is that of an axis; and who agrees again is not watched for it.
    askew = verdict("disagrees", difference=(0.04, 0.04, 0, 0, 0, 0), chi_square=100)
    assert not tell(None, at(0, verdict(), askew), PAPER).is_disputed
    again = at(2, verdict(), near)
    assert "not chosen" in words_of([chosen, again], NAMES, PAPER)
    (told,) = happenings([spare, chosen, again], NAMES, PAPER)
    assert (told.start_ns, told.end_ns) == (10**9, 10**9)


def test_happenings_are_the_stretches_with_the_worst_of_each():
    def apart(metres: float, chi_square: float) -> Any:
        return verdict("disagrees", difference=(metres, 0, 0, 0, 0, 0), chi_square=chi_square)

    both = verdict(), verdict()
    history = [at(0, *both), at(1, apart(0.03, 900), verdict()), at(2, apart(0.01, 40), verdict())]
    history += [at(3, *both), at(4, verdict("lost", "too_dark"), verdict("lost", "too_dark"))]
    told = happenings(history, NAMES, CONFIG)
    assert [(one.start_ns, one.end_ns, one.must_stop) for one in told] == [
        (10**9, 2 * 10**9, False),
        (4 * 10**9, 4 * 10**9, True),
    ]
    assert "differ by 30 mm" in told[0].words
    assert told[1].words.endswith("stop")


def test_the_history_is_not_changed():
    history = [at(0, verdict(), verdict("lost", "too_dark"))]
    first = words_of(history, NAMES, CONFIG)
    assert words_of(history, NAMES, CONFIG) == first


@pytest.mark.parametrize("reason", list(REASONS))
def test_every_reason_has_a_short_form(reason: str):
    assert 0 < len(short_words(reason)) <= 30
    assert reason_words(reason)
