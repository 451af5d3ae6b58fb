# SPDX-License-Identifier: Apache-2.0
"""Configuration from a YAML file and from `key=value`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from pilotage.errors import InputError

if TYPE_CHECKING:
    from pilotage import OdometryConfig


def load_config(path: Path | None = None, settings: Sequence[str] = ()) -> OdometryConfig:
    """Return the defaults, changed by the YAML file `path`, then by each `key=value` in order.

    InputError names file (or setting) and key where a key is unknown or a value out of range.
    """
    from pilotage import OdometryConfig

    values: dict[str, Any] = {}
    if path is not None:
        values = _read(path)
        _check(values, str(path))
    for setting in settings:
        change = _parse(setting)
        _check(change, f"--set {setting}")
        values.update(change)
    return OdometryConfig.from_dict(values)


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
        return {key.strip(): _number(yaml.safe_load(text))}
    except yaml.YAMLError:
        raise InputError(f"--set {setting}: {text!r} is not a value") from None


def _number(value: Any) -> Any:
    """Return words such as 1e-3, which YAML 1.1 takes for text, as the numbers people mean."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _check(values: dict[str, Any], where: str) -> None:
    from pilotage import OdometryConfig

    try:
        OdometryConfig.from_dict(values)
    except (ValueError, TypeError) as error:
        raise InputError(f"{where}: {error}") from error
