# SPDX-License-Identifier: Apache-2.0
"""Reconstructions as values and files: cameras where pictures were taken, and points they saw."""

from pilotage.models.colmap import (
    read_colmap_binary,
    read_colmap_text,
    write_colmap_binary,
    write_colmap_text,
)
from pilotage.models.model import Model
from pilotage.models.ply import read_ply, write_ply
from pilotage.models.trajectory import write_tum

__all__ = [
    "Model",
    "read_colmap_binary",
    "read_colmap_text",
    "read_ply",
    "write_colmap_binary",
    "write_colmap_text",
    "write_ply",
    "write_tum",
]
