# SPDX-License-Identifier: Apache-2.0
"""Pilotage: finding one's way by what one sees."""

from importlib.metadata import PackageNotFoundError, version

from pilotage import _core
from pilotage._core import (
    Camera,
    RectifiedStereo,
    Rectifier,
    StereoRig,
    Transform,
    triangulate,
)

try:
    __version__ = version("pilotage")
except PackageNotFoundError:  # used from its source tree, not installed
    __version__ = "unknown"

__all__ = [
    "Camera",
    "RectifiedStereo",
    "Rectifier",
    "StereoRig",
    "Transform",
    "__version__",
    "triangulate",
]

# The odometry's names, once the extension has them.
for _name in ("OdometryConfig", "OdometryResult", "Reason", "Status", "StereoOdometry"):
    if hasattr(_core, _name):
        globals()[_name] = getattr(_core, _name)
        __all__.append(_name)
