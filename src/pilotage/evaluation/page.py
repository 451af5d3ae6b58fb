# SPDX-License-Identifier: Apache-2.0
"""What all reports are made of: one page with nothing fetched from elsewhere, and its parts."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from pilotage.atomic_files import write_atomically
from pilotage.errors import PilotageError
from pilotage.pose_files import read_text
from pilotage.results import CALIBRATION, CONFIG, REPORT

CSS = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #222; background: #f4f5f7; margin: 0; }
main { max-width: 1120px; margin: 0 auto; padding: 24px 16px 48px; }
h1 { font-size: 24px; margin: 0; }
h2 { font-size: 17px; margin: 28px 0 10px; }
.made { color: #666; margin: 2px 0 18px; overflow-wrap: anywhere; }
.figures + .made { margin-top: 8px; }
.card { background: #fff; border: 1px solid #dfe2e6; border-radius: 8px; padding: 12px 14px; }
.verdict { font-size: 17px; border-left: 6px solid #009E73; }
.verdict.bad { border-left-color: #D55E00; }
.verdict p { margin: 4px 0; }
.warnings { border-left: 6px solid #D55E00; background: #fff6ef; margin-top: 12px; }
.warnings ul { margin: 4px 0; padding-left: 20px; }
.numbers { display: grid; grid-template-columns: repeat(auto-fill, minmax(150px, 1fr)); gap: 10px;
  margin-top: 12px; }
.numbers b { display: block; font-size: 20px; font-weight: 600; }
.numbers span { color: #555; font-size: 13px; }
.figures { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 12px;
  align-items: start; }
.figures .wide { grid-column: 1 / -1; }
figure { margin: 0; }
.caption { color: #555; font-size: 13px; margin-top: 6px; overflow-wrap: anywhere; }
svg, img { display: block; width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; width: 100%; }
th, td { text-align: left; padding: 4px 10px; border-bottom: 1px solid #e6e8eb; font-weight: 400;
  vertical-align: top; }
thead th { color: #555; font-size: 13px; }
.stop { color: #D55E00; font-weight: 600; }
.number { text-align: right; white-space: nowrap; }
pre { overflow-x: auto; font-size: 13px; margin: 8px 0 0; }
details { margin-top: 10px; }
summary { cursor: pointer; }
@media (max-width: 760px) { .figures { grid-template-columns: 1fr; } }
@media print { body { background: #fff; } .card { break-inside: avoid; } }
"""


def write_page(folder: Path, name: str, sections: Iterable[str]) -> None:
    """Write report.html into a results folder; figures among the sections are drawn alike."""
    import matplotlib as mpl

    from pilotage.evaluation.plots import STYLE

    with mpl.rc_context(STYLE):
        body = "\n".join(sections)
    write_atomically(
        folder / REPORT,
        "<!doctype html>\n<html lang='en'>\n<head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(name)}: Pilotage</title><style>{CSS}</style></head>\n"
        f"<body><main>\n{body}\n</main></body>\n</html>\n",
    )


def head(name: str, source: str, summary: Mapping[str, Any]) -> str:
    """Return the page's title: what was worked on, where it lies, and with which program."""
    version = f"Pilotage {summary.get('version', '')}".strip()
    commit = summary.get("commit")
    made = f"{version} ({commit[:12]})" if commit else version
    return f"<h1>{escape(name)}</h1><p class='made'>{escape(source)} &middot; {escape(made)}</p>"


def verdict_card(said: Iterable[str], *, is_bad: bool) -> str:
    """Return what the run amounts to, a paragraph for each sentence."""
    paragraphs = "".join(f"<p>{escape(sentence)}</p>" for sentence in said)
    return f"<div class='card verdict{' bad' if is_bad else ''}'>{paragraphs}</div>"


def warnings_card(warnings: Sequence[str], title: str = "Warnings") -> str:
    """Return what the user must know; empty without warnings."""
    if not warnings:
        return ""
    items = "".join(f"<li>{escape(warning)}</li>" for warning in warnings)
    return f"<div class='card warnings'><b>{escape(title)}</b><ul>{items}</ul></div>"


def number_cards(shown: Iterable[tuple[str, str]]) -> str:
    """Return a card for each value and its name."""
    cards = "".join(
        f"<div class='card'><b>{escape(value)}</b><span>{escape(name)}</span></div>"
        for value, name in shown
    )
    return f"<div class='numbers'>{cards}</div>"


def figure_card(svg: str, name: str, *, wide: bool = False) -> str:
    """Return a figure of the page, as wide as the page or half of it."""
    kind = "card wide" if wide else "card"
    return f"<figure class='{kind}' role='img' aria-label='{escape(name)}'>{svg}</figure>"


def appendix(folder: Path) -> str:
    """Return configuration and calibration of a results folder, folded up."""
    parts = []
    for name in (CONFIG, CALIBRATION):
        path = folder / name
        if path.exists():
            text = escape(read_text(path))
            parts.append(
                f"<details class='card'><summary>{name}</summary><pre>{text}</pre></details>"
            )
    return "<h2>How it was run</h2>" + "".join(parts)


def run_alone(draw: Callable[[Path], None]) -> int:
    """Draw the report of the folder named on the command line; 1 where it cannot be drawn."""
    try:
        draw(Path(sys.argv[1]))
    except PilotageError as error:
        print(error, file=sys.stderr)
        return 1
    return 0
