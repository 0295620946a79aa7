"""The page report.html: one file without links to other files, light and dark, printable."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import msgspec
import pandas as pd

from swarmctl.study.figures.base import Study, n_text
from swarmctl.study.figures.measures import factor_label, label, value_words
from swarmctl.study.statistics import RESAMPLES

CSS = """
:root { --ink: #1d2228; --quiet: #616b76; --paper: #fff; --card: #fff; --line: #dde2e8;
  --soft: #f5f7f9; color-scheme: light dark; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e3e7ec; --quiet: #9aa5b1; --paper: #15181c; --card: #fff; --line: #333a42;
    --soft: #1d2127; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 3rem 1.5rem 4rem; max-width: 60rem; background: var(--paper);
  color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", sans-serif; }
header p { margin: 0; color: var(--quiet); }
h1 { font-size: 1.9rem; line-height: 1.2; font-weight: 650; margin: .2rem 0 1.6rem;
  letter-spacing: -.01em; text-wrap: balance; }
h2 { font-size: 1.15rem; font-weight: 650; margin: 2.8rem 0 .8rem; padding-top: .9rem;
  border-top: 1px solid var(--line); }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .25rem 1.4rem; margin: 0;
  font-size: .92rem; }
dt { color: var(--quiet); } dd { margin: 0; overflow-wrap: anywhere; }
figure { margin: 0 0 2.6rem; break-inside: avoid; }
figure h3 { font-size: 1rem; font-weight: 600; margin: 0 0 .6rem; }
figure .paper { background: var(--card); padding: .9rem; border: 1px solid var(--line);
  border-radius: 6px; text-align: center; }
figure img { width: 100%; height: auto; display: block; margin: auto; }
  figure img.one { max-width: 31rem; }
figcaption { margin-top: .6rem; font-size: .87rem; color: var(--quiet); max-width: 46rem; }
figcaption b { color: var(--ink); font-weight: 600; }
.scroll { overflow-x: auto; border: 1px solid var(--line); border-radius: 6px; }
table { border-collapse: collapse; width: 100%; font-size: .84rem;
  font-variant-numeric: tabular-nums; }
th, td { padding: .35rem .8rem; text-align: right; white-space: nowrap; }
th { font-weight: 600; color: var(--quiet); vertical-align: bottom; white-space: normal;
  min-width: 6rem; }
thead th { border-bottom: 1px solid var(--line); background: var(--soft); }
tbody tr + tr td { border-top: 1px solid var(--line); } td small { color: var(--quiet);
  font-size: .78rem; margin-left: .35rem; }
.factor { text-align: left; min-width: 4rem; }
pre { background: var(--soft); border: 1px solid var(--line); border-radius: 6px;
  padding: .8rem 1rem; overflow-x: auto; font-size: .85rem; }
.problem { border-left: 3px solid #b3261e; padding-left: .8rem; }
footer { margin-top: 3rem; color: var(--quiet); font-size: .82rem; }
@media print { body { padding: 0; max-width: none; font-size: 10pt; } .scroll { overflow: visible;
  border: 0; }
  table { font-size: 7pt; } th, td { padding: .15rem .4rem; } th { min-width: 0; }
    tr { break-inside: avoid; } }
"""


class DrawnFigure(msgspec.Struct, frozen=True):
    """A figure of the report."""

    name: str
    title: str
    caption: str
    svg: bytes
    width: str


def page(
    question: str,
    manifest: Mapping[str, Any],
    study: Study,
    figures: Sequence[DrawnFigure],
    table: pd.DataFrame,
    problems: Sequence[str],
) -> str:
    """Return the HTML text."""
    title = question or "A study"
    parts = [
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{CSS}</style>\n</head>\n<body>",
        f"<header><p>swarmctl study</p><h1>{_formulas(title)}</h1></header>",
        _facts(manifest, study),
    ]
    parts += [f'<p class="problem">{escape(problem)}</p>' for problem in problems]
    if figures:
        parts += ["<h2>Figures</h2>", *(_figure(n, figure) for n, figure in enumerate(figures, start=1))]
    parts += [
        "<h2>Levels</h2>",
        _table(table, study),
        "<h2>How the intervals are made</h2>",
        _method(study),
        "<h2>Run it again</h2>",
        _again(manifest),
        f"<footer>{escape(_versions(manifest))}</footer>\n</body>\n</html>\n",
    ]
    return "\n".join(parts)


def _facts(manifest: Mapping[str, Any], study: Study) -> str:
    seeds = study.table["seed"]
    facts = [(factor_label(name), f"{_values(values)} ({name})") for name, values in study.factors.items()]
    facts += [
        ("Levels", n_text(int(study.table["level"].nunique()))),
        ("Worlds a level", f"{n_text(study.n_worlds)}, seeds {seeds.min()} to {seeds.max()}"),
        ("Missions", n_text(study.table.groupby(["level", "seed"]).ngroups)),
    ]
    if elapsed := manifest.get("elapsed_s"):
        n_workers = manifest.get("workers")
        cores = f" on {n_workers} core{'s' * (n_workers > 1)}" if n_workers else ""
        facts.append(("Time", f"{_duration(float(elapsed))}{cores}"))
    if manifest.get("started"):
        facts.append(("Started", str(manifest["started"])))
    if manifest.get("commit"):
        facts.append(("Commit", str(manifest["commit"])))
    rows = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in facts)
    return f"<dl>{rows}</dl>"


def _values(values: Sequence[object]) -> str:
    texts = [value_words(value) for value in values]
    if len(texts) > 12:
        return f"{texts[0]}, {texts[1]}, … {texts[-1]}: {len(texts)} values"
    return ", ".join(texts)


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def _figure(number: int, figure: DrawnFigure) -> str:
    data = base64.b64encode(figure.svg).decode("ascii")
    title = f"<h3>{_formulas(figure.title)}</h3>" if figure.title else ""
    text = f"<b>Figure {number}.</b> {_formulas(figure.caption)}"
    image = (
        f'<img class="{figure.width}" alt="{escape(figure.caption)}" src="data:image/svg+xml;base64,{data}">'
    )
    note = f" <code>figures/{escape(figure.name)}.pdf</code>"
    return f'<figure>{title}<div class="paper">{image}</div><figcaption>{text}{note}</figcaption></figure>'


def _formulas(text: str) -> str:
    return escape(text).replace("P_s", "<i>P</i><sub>s</sub>")


def _table(table: pd.DataFrame, study: Study) -> str:
    factors = [*study.factors]
    measures = [name for name in table.columns if f"{name}_low" in table.columns]
    head = "".join(f'<th class="factor">{escape(factor_label(name))}</th>' for name in factors)
    head += "<th>worlds</th>" + "".join(f"<th>{_formulas(label(name))}</th>" for name in measures)
    rows = []
    for record in table.to_dict("records"):
        cells = "".join(f'<td class="factor">{escape(value_words(record[name]))}</td>' for name in factors)
        cells += f"<td>{record['worlds']}</td>"
        for name in measures:
            cells += f"<td>{_cell(record[name], record[f'{name}_low'], record[f'{name}_high'])}</td>"
        rows.append(f"<tr>{cells}</tr>")
    body = "\n".join(rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table></div>'


def _cell(value: Any, low: Any, high: Any) -> str:
    if pd.isna(value):
        return "–"
    width = high - low
    digits = 3 if pd.isna(width) or width <= 0 else max(0, min(5, 2 - _magnitude(width)))
    if pd.isna(low) or pd.isna(high):
        return f"{value:.{digits}f}"
    return f"{value:.{digits}f}<small>{low:.{digits}f} to {high:.{digits}f}</small>"


def _magnitude(width: float) -> int:
    return len(f"{width:.0f}") if width >= 1 else int(f"{width:e}".split("e")[1]) + 1


def _method(study: Study) -> str:
    worlds, samples = n_text(study.n_worlds), n_text(RESAMPLES)
    return f"""<p>A world is what one seed draws: the hostiles, and the draws of strikes, sensors and radio.
All levels meet the same worlds. Vehicles of one world are not independent, so the world is the unit of every
interval. Intervals have a confidence of 95 %.</p>
<p>Means, counts and rates have percentile bootstrap intervals from {samples} samples of the {worlds} worlds,
expanded for few worlds. Differences compare levels in equal samples of worlds. Shares have Wilson intervals;
the number of vehicles is divided by the design effect, which measures how alike the vehicles of one world
fare. No interval is corrected for the number of comparisons.</p>"""


def _again(manifest: Mapping[str, Any]) -> str:
    command = str(manifest.get("command") or "swarmctl study --config experiment.yaml")
    lines = []
    if commit := str(manifest.get("commit") or "").removesuffix("+"):
        lines.append(f"git checkout {commit}")
    lines.append(command)
    note = "<p>Equal versions and seeds give the same results. "
    note += "<code>swarmctl study report FOLDER</code> draws the figures again, "
    note += "also after changes of <code>figures:</code> in its experiment.yaml.</p>"
    return f"<pre>{escape(chr(10).join(lines))}</pre>{note}"


def _versions(manifest: Mapping[str, Any]) -> str:
    return " · ".join(f"{name} {version}" for name, version in manifest.get("versions", {}).items())
