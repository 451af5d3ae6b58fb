# SPDX-License-Identifier: Apache-2.0
"""What a camera does to the light that its lens model does not say: presets, and YAML of one's own.

The levels of the presets are of the size that data sheets of such sensors give; none was measured.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pilotage.errors import InputError
from pilotage.simulation.options import check_options, chosen, ranged, read_options, unknown

PRESET_KEY = "preset"


@dataclass(frozen=True)
class Sensor:
    """A sensor and its lens; the defaults are those of a good camera with a global shutter.

    Noise is given in grey values at gain 1; beyond the longest exposure a gain makes up for the
    missing light and raises the noise. InputError when a value lies out of its range.
    """

    blur_px: float = ranged(0.6, 0, 10)  # standard deviation of the lens
    vignetting: float = ranged(0.2, 0, 0.9)  # part of the light that is missing in the corners
    # How long white takes to come out white, by day and at gain 1. A sunny day has 50 klx and
    # more; at f/2 pixels of 3 um have enough of it within a millisecond or two.
    exposure_at_white_s: float = ranged(0.0015, 1e-6, 1)
    longest_exposure_s: float = ranged(0.010, 1e-5, 0.05)
    exposure_s: float = ranged(0.0, 0, 0.05)  # 0: regulated; else this, and only gain is regulated
    largest_gain: float = ranged(16.0, 1, 256)
    target_grey: float = ranged(110.0, 1, 250)  # mean that the exposure is regulated to
    reaction: float = ranged(0.3, 0.001, 1)  # part of the way there, each picture
    read_noise: float = ranged(0.8, 0, 50)
    # Light's own noise at white: 255 over the root of 10 000 electrons, the full well of a pixel.
    shot_noise_at_white: float = ranged(2.5, 0, 50)
    pattern: float = ranged(0.003, 0, 0.2)  # standard deviation of the pixels' own sensitivities
    gain_mismatch: float = ranged(0.0, 0, 0.5)  # the same between cameras
    readout_s: float = ranged(0.0, 0, 0.05)  # from the first row to the last; 0: global shutter
    stamp_jitter_s: float = ranged(0.0, 0, 0.05)  # standard deviation
    stamp_offset_s: float = ranged(0.0, -0.2, 0.2)  # how late all stamps are
    drop_share: float = ranged(0.0, 0, 1)  # of the frames
    jpeg_quality: int = ranged(0, 0, 100)  # 0: not compressed
    pictures: str = chosen("grey", ("grey", "colour"))

    def __post_init__(self) -> None:
        check_options(self, "sensor")

    @property
    def channels(self) -> int:
        """Return 1 for grey, 3 for colour."""
        return 3 if self.pictures == "colour" else 1

    @classmethod
    def ideal(cls) -> Sensor:
        """Return a sensor that errs only in its 8 bits and its regulated exposure."""
        return cls(
            blur_px=0.0,
            vignetting=0.0,
            exposure_s=1e-5,  # too short for anything to move
            exposure_at_white_s=5e-5,
            largest_gain=256.0,
            read_noise=0.0,
            shot_noise_at_white=0.0,
            pattern=0.0,
        )

    @classmethod
    def realistic(cls) -> Sensor:
        """Return a cheap USB camera: a rolling shutter, motion blur, noise, jitter, JPEG."""
        return cls(
            blur_px=0.9,  # an M12 lens, focused by hand
            vignetting=0.4,  # cos^4 of 33 degrees, the corner of an 1280x960 picture with f 855 px
            exposure_at_white_s=0.004,  # a bright day without sun, some 15 klx
            longest_exposure_s=0.015,
            largest_gain=16.0,
            read_noise=1.2,
            shot_noise_at_white=3.2,  # full well of 6 000 electrons: pixels of 3 um
            pattern=0.008,  # EMVA 1288 reports of CMOS sensors give 0.5 to 1 %
            gain_mismatch=0.04,
            readout_s=0.016,  # most of the frame at 56 frames/s, as rows are read without a pause
            stamp_jitter_s=0.001,  # stamped by a driver when a USB transfer ends
            drop_share=0.005,
            jpeg_quality=90,  # 1280x960 at 56 frames/s fit through USB 2 only compressed
        )


PRESETS = {"good": Sensor, "ideal": Sensor.ideal, "realistic": Sensor.realistic}


def make_sensor(values: Mapping[str, object], where: str) -> Sensor:
    """Return a preset (key `preset`, default `good`), changed by the other keys, fields of Sensor.

    InputError names `where`, the key, and the known key nearest to it.
    """
    name = str(values.get(PRESET_KEY, "good"))
    if name not in PRESETS:
        raise InputError(f"{where}: preset {name!r} {unknown(name, PRESETS)}")
    changes = {key: value for key, value in values.items() if key != PRESET_KEY}
    read_options(Sensor, changes, where)
    return read_options(Sensor, dataclasses.asdict(PRESETS[name]()) | changes, where)


def read_sensor(source: str | Path) -> Sensor:
    """Return the sensor of that name (`good`, `ideal`, `realistic`) or of a YAML file.

    InputError names the file, the key, and the known key nearest to it.
    """
    if str(source) in PRESETS:
        return PRESETS[str(source)]()
    path = Path(source)
    if path.suffix.lower() not in {".yaml", ".yml"}:
        raise InputError(f"camera {str(source)!r} {unknown(str(source), PRESETS)}, or give a .yaml")
    from pilotage.calibration.document import read_documents

    values = read_documents(path)[0].values
    return make_sensor({str(key): value for key, value in values.items()}, str(path))
