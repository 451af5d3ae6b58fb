# SPDX-License-Identifier: Apache-2.0
"""With what a recording was simulated, as it says itself: enough to make it again."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pilotage import __version__
from pilotage.errors import InputError
from pilotage.simulation.drives import Drive
from pilotage.simulation.encoders import Encoders
from pilotage.simulation.faults import ALL, KINDS, Fault, read_faults
from pilotage.simulation.models import RobotModel
from pilotage.simulation.nao import Nao
from pilotage.simulation.options import read_options
from pilotage.simulation.physics import Simulation
from pilotage.simulation.sensor import PRESETS, Sensor, make_sensor
from pilotage.simulation.world import World


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Everything a simulated recording depends on, but the program itself: `version` names that.

    `world` is a name or, with `world_sha256` of its text, an MJCF file. `seed` is that of the world
    and the cameras, `body_seed` of what the body does at random. `rate_hz` and `pairs` are of a
    drive, `stops` of a walk with stops, `encoders` of a head.
    """

    world: str
    world_options: Mapping[str, Any] = field(default_factory=dict)
    world_sha256: str
    seed: int
    robot: str
    body_seed: int
    path: str
    speed_m_s: float
    width_px: int
    rate_hz: float | None = None
    pairs: tuple[str, ...] = ()
    stops: Mapping[str, Any] | None = None
    camera: Sensor
    encoders: Encoders | None = None
    faults: tuple[Fault, ...] = ()
    version: str = __version__

    @property
    def words(self) -> str:
        """Return the most of it in a line; seeds and all values stand in the record itself."""
        ground = self.world_options.get("ground")
        presets = {make(): name for name, make in PRESETS.items()}
        parts = [
            self.world + (f" ({ground})" if ground else ""),
            f"seed {self.seed}",
            f"{self.robot} along {self.path} at {self.speed_m_s:g} m/s",
            f"camera {presets.get(self.camera, 'with settings of its own')}",
            f"faults: {', '.join(map(_fault_words, self.faults))}" if self.faults else "no faults",
        ]
        return "; ".join(parts)

    def to_record(self) -> dict[str, str]:
        """Return it as names and texts, whatever is no text as JSON; `words` are for people."""
        values = {
            **{entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)},
            "camera": dataclasses.asdict(self.camera),
            "encoders": self.encoders and dataclasses.asdict(self.encoders),
            "faults": [_fault_values(fault) for fault in self.faults],
        }
        texts = {key: _text(value) for key, value in values.items() if value is not None}
        return {"words": self.words, **texts}

    @classmethod
    def from_record(cls, record: Mapping[str, str], where: str) -> Origin:
        """Return what `to_record` gave; InputError names `where` and the key that is wrong."""
        values: dict[str, Any] = {}
        for entry in dataclasses.fields(cls):
            is_needed = entry.default is entry.default_factory is dataclasses.MISSING
            if entry.name in record:
                values[entry.name] = _value(record[entry.name], entry.name, where)
            elif is_needed:
                raise InputError(f"{where}: has no {entry.name}; record it again")
        values["camera"] = make_sensor(_mapping(values["camera"], where), f"{where}: camera")
        if values.get("encoders") is not None:
            given = _mapping(values["encoders"], where)
            values["encoders"] = read_options(Encoders, given, f"{where}: encoders")
        values["faults"] = tuple(read_faults(values.get("faults", ())))
        return cls(**{**values, "pairs": tuple(values.get("pairs", ()))})


def origin_of(  # noqa: PLR0913, what a recording depends on
    simulation: Simulation,
    robot: RobotModel,
    drive: Drive,
    sensor: Sensor,
    *,
    width_px: int,
    rate_hz: float | None = None,
    pairs: Sequence[str] = (),
    stops: Mapping[str, Any] | None = None,
) -> Origin:
    """Return with what a recording of that drive is made."""
    world, body = simulation.world, simulation.body
    return Origin(
        world=world.name if world.path is None else world.path.name,
        world_options=world.options,
        world_sha256=_sha256(world),
        seed=world.seed,
        robot=robot.name,
        body_seed=simulation.seed,
        path=drive.path.name,
        speed_m_s=drive.speed_m_s,
        width_px=width_px,
        rate_hz=rate_hz,
        pairs=tuple(pairs),
        stops=stops,
        camera=sensor,
        encoders=body.encoders if isinstance(body, Nao) else None,
        faults=simulation.faults,
    )


def _sha256(world: World) -> str:
    return hashlib.sha256(world.mjcf.encode()).hexdigest()


def _fault_values(fault: Fault) -> dict[str, Any]:
    """Return the fault as `--faults` takes it; JSON has no number for a fault that lasts."""
    values = dataclasses.asdict(fault)
    ordinary = {"duration_s": math.inf, "camera": ALL}
    return {key: value for key, value in values.items() if ordinary.get(key) != value}


def _fault_words(fault: Fault) -> str:
    whose = "" if fault.camera == ALL else f" of {fault.camera}"
    lasts = "" if fault.duration_s == math.inf else f" for {fault.duration_s:g} s"
    told = f"{fault.name} {fault.size:g}{whose}"
    is_written = KINDS[fault.name].part == "calibration"
    return told if is_written else f"{told} from {fault.onset_s:g} s{lasts}"


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _value(text: str, key: str, where: str) -> Any:
    kinds = {entry.name: entry.type for entry in dataclasses.fields(Origin)}
    if kinds[key] == "str":
        return text
    try:
        return json.loads(text)
    except ValueError:
        raise InputError(f"{where}: {key} = {text!r} is no JSON") from None


def _mapping(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: {value!r}: must be a mapping of keys to values")
    return dict(value)
