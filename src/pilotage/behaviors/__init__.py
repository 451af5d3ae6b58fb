# SPDX-License-Identifier: Apache-2.0
"""The loops: what is done with a recording or a robot, step by step."""
