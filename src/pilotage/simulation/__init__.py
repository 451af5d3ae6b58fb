# SPDX-License-Identifier: Apache-2.0
"""Simulated worlds, the bodies that move in them, faults, and drives for tests."""
