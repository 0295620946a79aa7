"""The verdict of a run, as verdict.json and as text for a terminal."""

import json
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from sim_vehicle.scenarios.runner import FinalVehicleState, Verdict
from sim_vehicle.serving.columns import Column, table

MAX_SHOWN_FAILURES, MAX_SHOWN_VEHICLES = 3, 40
MIN_TEXT_WIDTH = 20  # minimum width of the column with the last text [characters]
INDENT = " " * 8
DECIMALS = 6


def write_verdict(folder: Path, verdict: Verdict) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(_rounded(verdict.as_dict()), indent=1, allow_nan=False)
    (folder / "verdict.json").write_text(text + "\n", encoding="utf-8")


def _rounded(value: Any) -> Any:
    """Return the value with all floats rounded: 75.1 instead of 75.10000000000001."""
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(inner) for inner in value]
    return round(value, DECIMALS) if isinstance(value, float) else value


def print_verdict(console: Console, verdict: Verdict) -> None:
    """Print checks, failed steps and final states; wrap and cut lines only on a terminal."""
    width = console.width if console.is_terminal else None
    lines = fold(Text(f"{verdict.scenario}, seed {verdict.seed}"), width, "  ")
    lines[0].stylize("bold")
    for check in verdict.checks:
        lines += _verdict_lines(check.check, width, passed=check.passed)
        found = [
            f"vehicle {f.sysid} at {f.t_s:.2f} s: {f.found}" for f in check.failures[:MAX_SHOWN_FAILURES]
        ]
        more = len(check.failures) - len(found)
        for text in [*found, *([f"and {more} more"] if more else [])]:
            lines += fold(Text(f"{INDENT}{text}"), width, INDENT + "  ")
    for failed in verdict.steps_failed:
        lines += _verdict_lines(f"step {failed.index + 1}: {failed.action}", width, passed=False)
        text = f"vehicle {failed.sysid} at {failed.t_s:.2f} s: {failed.text}"
        lines += fold(Text(f"{INDENT}{text}"), width, INDENT + "  ")
    lines += [Text(), *table(_columns(verdict.vehicles[:MAX_SHOWN_VEHICLES]), width)]
    if len(verdict.vehicles) > MAX_SHOWN_VEHICLES:
        lines.append(Text(f"and {len(verdict.vehicles) - MAX_SHOWN_VEHICLES} more vehicles, in verdict.json"))
    for line in lines:
        console.print(line, soft_wrap=True)


def _verdict_lines(about: str, width: int | None, *, passed: bool) -> list[Text]:
    word = "passed" if passed else "FAILED"
    lines = fold(Text(f"{word}  {about}"), width, INDENT)
    lines[0].stylize("green" if passed else "red", 0, len(word))
    return lines


def fold(text: Text, width: int | None, indent: str) -> list[Text]:
    """Return a text as lines of at most `width` characters, indented after the first; None: one line."""
    if width is None:
        return [text]
    parts = textwrap.wrap(text.plain, width, subsequent_indent=indent, break_on_hyphens=False)
    return [Text(part) for part in parts]


def _columns(vehicles: Sequence[FinalVehicleState]) -> list[Column]:
    def column(heading: str, cells: Iterable[str], priority: int, **options: Any) -> Column:
        return Column(heading, [Text(cell) for cell in cells], priority, **options)

    ids = (f"{v.link}:{v.sysid}" if v.link else f"{v.sysid}" for v in vehicles)
    return [
        column("id", ids, 10),
        column("autopilot", (f"{v.personality} {v.kind}" for v in vehicles), 5),
        column("mode", (v.mode for v in vehicles), 8),
        column("armed", ("yes" if v.armed else "no" for v in vehicles), 4),
        column("up [m]", (f"{v.height_m:.1f}" for v in vehicles), 7, right=True),
        column("off [m]", (f"{v.from_start_m:.1f}" for v in vehicles), 6, right=True),
        column("flown [m]", (f"{v.flown_m:.0f}" for v in vehicles), 3, right=True),
        column("charge", (f"{v.battery_remaining:.0%}" for v in vehicles), 9, right=True),
        column("hit", (str(v.strikes) for v in vehicles), 2, right=True),
        column("last text", (v.last_text for v in vehicles), 1, min_cut_width=MIN_TEXT_WIDTH),
    ]
