# SPDX-License-Identifier: Apache-2.0
"""How good a trajectory is, and the page that shows it."""
