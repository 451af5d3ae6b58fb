# SPDX-License-Identifier: Apache-2.0
"""Figures as text: four digits, and tables that read well in a terminal and in Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence


def number(value: float) -> str:
    """Return four significant digits; nothing for NaN, integers in full."""
    if math.isnan(value):
        return ""
    if math.isinf(value):
        return "inf"
    if value == round(value) and abs(value) < 1e6:
        return str(int(value))
    return f"{value:.4g}"


def markdown_table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table whose columns are aligned; leaves out columns that are empty."""
    kept = [i for i in range(len(titles)) if not rows or any(row[i] for row in rows)]
    lines = [[titles[i] for i in kept], *([row[i] for i in kept] for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(kept))]
    texts = ["| " + " | ".join(_padded(line, widths)) + " |" for line in lines]
    texts.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(texts)


def _padded(cells: Sequence[str], widths: Sequence[int]) -> list[str]:
    return [cell.ljust(width) for cell, width in zip(cells, widths, strict=True)]
