# SPDX-License-Identifier: Apache-2.0
"""Pilotage: finding one's way by what one sees."""

from importlib.metadata import PackageNotFoundError, version

from pilotage._core import (
    Belief,
    CalibrationCheck,
    CalibrationVerdict,
    Camera,
    JointResult,
    Judge,
    JudgeConfig,
    LengthEstimate,
    LengthSource,
    MarkAccount,
    MarkSighting,
    OdometryConfig,
    OdometryResult,
    PairVerdict,
    PictureFate,
    PlacedStop,
    Reason,
    Reconstruction,
    ReconstructionConfig,
    RectifiedStereo,
    Rectifier,
    Status,
    StepAccount,
    StereoOdometry,
    StereoRig,
    StopFate,
    Transform,
    WalkAccount,
    WalkReconstruction,
    triangulate,
)

try:
    __version__ = version("pilotage")
except PackageNotFoundError:  # used from its source tree, not installed
    __version__ = "unknown"

__all__ = [
    "Belief",
    "CalibrationCheck",
    "CalibrationVerdict",
    "Camera",
    "JointResult",
    "Judge",
    "JudgeConfig",
    "LengthEstimate",
    "LengthSource",
    "MarkAccount",
    "MarkSighting",
    "OdometryConfig",
    "OdometryResult",
    "PairVerdict",
    "PictureFate",
    "PlacedStop",
    "Reason",
    "Reconstruction",
    "ReconstructionConfig",
    "RectifiedStereo",
    "Rectifier",
    "Status",
    "StepAccount",
    "StereoOdometry",
    "StereoRig",
    "StopFate",
    "Transform",
    "WalkAccount",
    "WalkReconstruction",
    "__version__",
    "triangulate",
]
