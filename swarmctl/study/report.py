"""The output of a study for people: summary.csv, figures/ and report.html, from the results folder alone."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from swarmctl.config.yaml_lines import YamlError, parse
from swarmctl.study.figures import caption, draw, validate
from swarmctl.study.figures.base import Spec, Study
from swarmctl.study.figures.measures import DERIVED, estimate
from swarmctl.study.figures.style import files, print_style, svg
from swarmctl.study.report_page import DrawnFigure, page
from swarmctl.study.results import read_manifest
from swarmctl.study.tables import KEY_COLUMNS


class ReportError(ValueError):
    """A results folder without what the report needs, or with a figure that cannot be drawn."""


def write(folder: Path) -> Path:
    """Write summary.csv, figures/ and report.html, and return the path of report.html.

    Reads the tables, manifest.json and experiment.yaml of the folder and nothing else. One figure that
    fails does not stop the others: ReportError, raised at the end, names all that failed.
    """
    manifest = manifest_of(folder)
    study = read(folder, manifest)
    question, entries = _experiment(folder, manifest)
    summary = summarise(study)
    summary.to_csv(folder / "summary.csv", index=False, float_format="%.6g", lineterminator="\n")
    (folder / "figures").mkdir(exist_ok=True)
    drawn: list[DrawnFigure] = []
    problems: list[str] = []
    shown: list[str] = []
    for number, entry in enumerate(entries, start=1):
        try:
            spec = validate(entry, study.factors, study.measures)
            drawn.append(_draw(folder, study, spec, number))
            shown += [name for name in sorted(spec.measures()) if name not in shown]
        except ValueError as error:
            problems.append(f"figure {number}: {error}")
    _remove_older(folder / "figures", [figure.name for figure in drawn])
    path = folder / "report.html"
    columns = [*shown, *(name for name in ("strikes", "exposure_sum") if name in study.measures)]
    table = summary[_columns(summary, study.factors, list(dict.fromkeys(columns)) or study.measures)]
    text = page(question, manifest, study, drawn, table, problems)
    path.write_text(text, encoding="utf-8", newline="\n")
    if problems:
        raise ReportError(f"{path} lacks figures. {' '.join(problems)} [study-figure]")
    return path


def read(folder: Path, manifest: Mapping[str, Any]) -> Study:
    """Return the results of a folder. Raises ReportError if there are none."""
    path = folder / "results.parquet"
    if not path.exists():
        raise ReportError(f"{folder} has no results.parquet; run `swarmctl study` until it ends [study-none]")
    table = pd.read_parquet(path)
    if table.empty:
        raise ReportError(f"{path} has no rows; run the study again [study-none]")
    factors: dict[str, Sequence[object]] = {
        name: values for name, values in manifest.get("factors", {}).items() if name in table
    }
    for name in factors:
        if table[name].dtype == object or isinstance(table[name].dtype, pd.CategoricalDtype):
            table[name] = table[name].astype(str)
    measures = [
        name
        for name in table.columns
        if name not in (*KEY_COLUMNS, *factors) and table[name].dtype.kind in "biuf"
    ]
    tracks, hostiles = (_table(folder / f"{name}.parquet") for name in ("tracks", "hostiles"))
    return Study(table, factors, measures, (manifest["rows"], manifest["cols"]), tracks, hostiles)


def summarise(study: Study) -> pd.DataFrame:
    """Return one row a level: factors, worlds, vehicles, and each measure with the limits of its interval."""
    table = study.table
    levels, first = np.unique(table["level"].to_numpy(), return_index=True)
    groups = np.searchsorted(levels, table["level"].to_numpy())
    columns: dict[str, Any] = {"level": levels}
    columns |= {name: table[name].to_numpy()[first] for name in study.factors}
    columns["worlds"] = table.groupby("level")["seed"].nunique().to_numpy()
    columns["vehicles"] = table.groupby("level").size().to_numpy()
    derived = [name for name, needed in DERIVED.items() if needed <= set(study.measures)]
    for name in (*study.measures, *derived):
        found = estimate(table, name, groups, (len(levels),))
        columns |= {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high}
    return pd.DataFrame(columns)


def _columns(summary: pd.DataFrame, factors: Mapping[str, object], measures: Sequence[str]) -> list[str]:
    names = [f"{name}{end}" for name in measures for end in ("", "_low", "_high")]
    return [*factors, "worlds", *(name for name in names if name in summary)]


def _draw(folder: Path, study: Study, spec: Spec, number: int) -> DrawnFigure:
    name = spec.file_name(number)
    with print_style():
        figure = draw(study, spec)
        files(figure, folder / "figures", name)
        return DrawnFigure(name, spec.title, caption(study, spec), svg(figure), spec.width)


def _remove_older(figures: Path, names: Sequence[str]) -> None:
    """Remove the figures of an earlier report that this one does not have; other files stay."""
    index = figures / "index.json"
    earlier = json.loads(index.read_text(encoding="utf-8")) if index.exists() else []
    for name in set(earlier) - set(names):
        for suffix in ("png", "pdf"):
            (figures / f"{name}.{suffix}").unlink(missing_ok=True)
    index.write_text(json.dumps(names), encoding="utf-8", newline="\n")


def _table(path: Path) -> pd.DataFrame | None:
    return pd.read_parquet(path) if path.exists() else None


def manifest_of(folder: Path) -> dict[str, Any]:
    """Return the manifest of a results folder. Raises ReportError if there is none."""
    if not (manifest := read_manifest(folder)):
        raise ReportError(f"{folder} has no manifest.json; name the folder of a study [study-none]")
    return manifest


def _experiment(folder: Path, manifest: Mapping[str, Any]) -> tuple[str, Sequence[Mapping[str, Any]]]:
    """Return question and figures of experiment.yaml, where a person may have changed them."""
    path = folder / "experiment.yaml"
    if not path.exists():
        return str(manifest.get("question", "")), ()
    try:
        data = parse(path.read_text(encoding="utf-8")).data
    except YamlError as error:
        raise ReportError(f"{path}:{error.line}: {error.text}") from error
    if not isinstance(data, dict) or not all(isinstance(entry, dict) for entry in data.get("figures") or ()):
        raise ReportError(f"{path}: `figures` is no list of figures; each has a `kind` and its keys")
    return str(data.get("question", "")), data.get("figures") or ()
