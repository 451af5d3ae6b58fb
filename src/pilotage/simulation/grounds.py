# SPDX-License-Identifier: Apache-2.0
"""Kinds of ground and how a track grips them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Ground:
    """`friction` of sliding; `firmness` 0 to 1, how little it shears; `rolling_m`, resistance.

    Figures are of the size found in tables for rubber tracks; none was measured on a rover.
    """

    friction: float
    firmness: float
    rolling_m: float

    def attributes(self) -> dict[str, Any]:
        """Return the geom's attributes; its priority makes them those of every contact."""
        return {
            "priority": 1,
            # MuJoCo's contacts of six dimensions resist rolling, those of three do not.
            "condim": 6 if self.rolling_m > 0 else 3,
            "friction": [self.friction, 0.005, self.rolling_m],
            "solref": [0.01, 1],
            "solimp": [self.firmness, min(0.99, self.firmness + 0.05), 0.002],
        }


GROUNDS = {
    "asphalt": Ground(friction=0.90, firmness=0.92, rolling_m=0.0),
    "grass": Ground(friction=0.60, firmness=0.75, rolling_m=0.007),
    "gravel": Ground(friction=0.60, firmness=0.7, rolling_m=0.008),
    "soil": Ground(friction=0.70, firmness=0.8, rolling_m=0.005),
    "sand": Ground(friction=0.50, firmness=0.45, rolling_m=0.015),
}
FLOORS = {
    "carpet": Ground(friction=0.80, firmness=0.88, rolling_m=0.0),
    "wood": Ground(friction=0.60, firmness=0.94, rolling_m=0.0),
}
