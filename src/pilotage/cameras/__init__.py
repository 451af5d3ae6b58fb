# SPDX-License-Identifier: Apache-2.0
"""Cameras: one protocol, one file a driver."""

from pilotage.cameras.camera import Camera, Frame

__all__ = ["Camera", "Frame"]
