# SPDX-License-Identifier: Apache-2.0
"""Configuration from a YAML file and from `key=value`.

points: 300                # of every stereo pair's odometry
pairs:
  down: {points: 200}      # of one pair, by name
judge: {window_s: 2.0}     # of the comparison of several pairs
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from pilotage.errors import InputError, did_you_mean

if TYPE_CHECKING:
    from pilotage import JudgeConfig, OdometryConfig, ReconstructionConfig

PAIRS, JUDGE = "pairs", "judge"
# What a pair that looks down needs otherwise. Seen from straight above, an offset of the right
# picture cannot be told from height, so it is not estimated.
DOWNWARD: dict[str, Any] = {"front_end": "grid", "right_x_offset_prior_px": 0}

REGIONS = ("uses_dog", "uses_harris", "uses_fast_hessian", "uses_mser")


@dataclass(frozen=True)
class UserConfig:
    """What the user changed: of every pair, of each by name, of the judge. All keys are known.

    `pair_sources` tells where a pair was named, for errors.
    """

    shared: Mapping[str, Any] = field(default_factory=dict)
    pairs: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    judging: Mapping[str, Any] = field(default_factory=dict)
    pair_sources: Mapping[str, str] = field(default_factory=dict)

    def odometry(self, pair: str | None = None, *, is_downward: bool = False) -> OdometryConfig:
        """Return the configuration of a pair's odometry; what the user says beats all else."""
        from pilotage import OdometryConfig

        fitting = DOWNWARD if is_downward else {}
        own = self.pairs.get(pair, {}) if pair is not None else {}
        return OdometryConfig.from_dict({**fitting, **self.shared, **own})

    def judge(self, **changes: Any) -> JudgeConfig:
        """Return the judge's configuration; what the user says beats `changes`."""
        from pilotage import JudgeConfig

        return JudgeConfig.from_dict({**changes, **self.judging})

    def check_pairs(self, names: Iterable[str]) -> None:
        """Raise InputError where a pair is configured that the recording does not have."""
        known = list(names)
        for name in self.pairs:
            if name not in known:
                raise InputError(
                    f"{self.pair_sources.get(name, 'config')}: {PAIRS}.{name}: the recording has no"
                    f" such stereo pair; it has {', '.join(known)}{did_you_mean(name, known)}"
                )


def load_config(path: Path | None = None, settings: Sequence[str] = ()) -> UserConfig:
    """Return what the YAML file `path` changes, then each `key=value` in order.

    Keys of a setting may be dotted: `pairs.down.points=200`, `judge.window_s=2`. InputError names
    file (or setting) and key where a key is unknown or a value out of range.
    """
    config = UserConfig()
    if path is not None:
        config = _changed(config, _read(path), str(path))
    for setting in settings:
        config = _changed(config, _parse(setting), f"--set {setting}")
    return config


def load_reconstruction_config(
    path: Path | None = None,
    settings: Sequence[str] = (),
    *,
    base: ReconstructionConfig | None = None,
) -> ReconstructionConfig:
    """Return what the user changes of `base`, or of the defaults; errors as in `load_config`."""
    from pilotage import ReconstructionConfig

    sources = [] if path is None else [(_read(path), str(path))]
    sources += [(_parse(setting), f"--set {setting}") for setting in settings]
    changes: dict[str, Any] = {} if base is None else base.to_dict()
    for values, where in sources:
        _check(values, ReconstructionConfig, where, "")
        changes |= values
        chosen = ReconstructionConfig.from_dict(changes).to_dict()
        if not any(chosen[kind] for kind in REGIONS):
            raise InputError(f"{where}: one of {', '.join(REGIONS)} must be true")
    return ReconstructionConfig.from_dict(changes)


def _changed(config: UserConfig, values: Mapping[str, Any], where: str) -> UserConfig:
    from pilotage import JudgeConfig, OdometryConfig

    shared = {key: value for key, value in values.items() if key not in {PAIRS, JUDGE}}
    _check(shared, OdometryConfig, where, "", extra=(PAIRS, JUDGE))
    judging = _mapping(values.get(JUDGE), where, JUDGE)
    _check(judging, JudgeConfig, where, f"{JUDGE}.")
    pairs = {name: dict(own) for name, own in config.pairs.items()}
    named = _mapping(values.get(PAIRS), where, PAIRS)
    for name, content in named.items():
        own = _mapping(content, where, f"{PAIRS}.{name}")
        _check(own, OdometryConfig, where, f"{PAIRS}.{name}.")
        pairs[name] = {**pairs.get(name, {}), **own}
    return UserConfig(
        {**config.shared, **shared},
        pairs,
        {**config.judging, **judging},
        {**config.pair_sources, **dict.fromkeys(named, where)},
    )


def _mapping(value: Any, where: str, key: str) -> dict[str, Any]:
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: {key} = {value!r}: must be a mapping of keys to values")
    return {str(name): _number(content) for name, content in value.items()}


def _check(
    values: Mapping[str, Any], kind: Any, where: str, place: str, *, extra: Sequence[str] = ()
) -> None:
    known = [*kind.describe(), *extra]
    for key in values:
        if key not in known:
            raise InputError(
                f"{where}: unknown key {place}{key}{did_you_mean(key, known)}; known are"
                f" {', '.join(known)}"
            )
    try:
        kind.from_dict(dict(values))
    except (ValueError, TypeError) as error:
        raise InputError(f"{where}: {place}{error}") from error


def _read(path: Path) -> dict[str, Any]:
    from pilotage.calibration.document import read_documents

    documents = read_documents(path)
    if len(documents) > 1:
        raise InputError(f"{path}: holds {len(documents)} YAML documents; keep one")
    return {str(key): _number(value) for key, value in documents[0].values.items()}


def _parse(setting: str) -> dict[str, Any]:
    key, separator, text = setting.partition("=")
    if not separator or not key.strip():
        raise InputError(f"--set {setting}: must be KEY=VALUE")
    try:
        value = _number(yaml.safe_load(text))
    except yaml.YAMLError:
        raise InputError(f"--set {setting}: {text!r} is not a value") from None
    for part in reversed(key.strip().split(".")):
        value = {part: value}
    return dict(value)


def _number(value: Any) -> Any:
    """Return words such as 1e-3, which YAML 1.1 takes for text, as the numbers people mean."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
