"""A results folder of a study: its figures as charts, the worlds of a point, and their missions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from swarmctl.config.scenario import build
from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.sources.mission import replayed
from swarmctl.study import report
from swarmctl.study.experiment import load_experiment
from swarmctl.study.figures import caption, validate
from swarmctl.study.figures.base import Spec, index_of
from swarmctl.study.figures.lines import Lines
from swarmctl.study.figures.measures import (
    estimate,
    factor_label,
    label,
    value_label,
    value_text,
    value_words,
)
from swarmctl.study.world import World

KEPT_MISSIONS = 8
"""missions kept for the next look"""
COMPARED = ("arrived", "length_cells", "strikes", "replans", "cells_known")
"""measures by which a mission flown again is compared with the results"""


class ChartPoint(msgspec.Struct, frozen=True):
    """A mean with the limits of its 95 % interval, and the levels that it is the mean of."""

    x: object
    value: float
    low: float
    high: float
    n_worlds: int
    levels: tuple[int, ...]


class Chart(msgspec.Struct, frozen=True):
    """One panel of a figure of the kind `lines`."""

    title: str
    caption: str
    x: str
    y: str
    x_scale: str
    series: dict[str, list[ChartPoint]]


class WorldResult(msgspec.Struct, frozen=True):
    """One world of some levels."""

    level: int
    seed: int
    values: dict[str, float]


class StudySource:
    """The results of a study, and its missions flown again."""

    def __init__(self, folder: Path) -> None:
        """Read a folder. Raises `report.ReportError` and ConfigError."""
        self.folder = folder
        self.experiment = load_experiment(folder / "experiment.yaml")
        self.study = report.read(folder, report.manifest_of(folder))
        self.names = [str(level) for level in self.experiment.levels]
        self.mission = lru_cache(KEPT_MISSIONS)(self._mission)

    @property
    def has_missions(self) -> bool:
        return self.experiment.section.kind == "missions"

    def charts(self) -> list[Chart]:
        """Return the panels of all figures of the kind `lines`."""
        return [chart for spec in self._specs() if isinstance(spec, Lines) for chart in self._panels(spec)]

    def pictures(self) -> list[tuple[str, str, Path]]:
        """Return title, caption and file of all other figures, as the study has drawn them."""
        found = []
        for number, spec in enumerate(self._specs(), start=1):
            path = self.folder / "figures" / f"{spec.file_name(number)}.png"
            if not isinstance(spec, Lines) and path.is_file():
                found.append((spec.title, caption(self.study, spec), path))
        return found

    def _specs(self) -> list[Spec]:
        study = self.study
        return [validate(entry, study.factors, study.measures) for entry in self.experiment.section.figures]

    def _panels(self, spec: Lines) -> list[Chart]:
        study = self.study
        index, shape = study.groups(spec, (spec.panels, spec.by, spec.x))
        level = study.table["level"].to_numpy()
        order = {flat: tuple(np.unique(level[index == flat]).tolist()) for flat in np.unique(index)}
        charts = []
        for measure in spec.y:
            found = estimate(study.table, measure, index, shape)
            for panel in study.shown(spec, spec.panels):
                series: dict[str, list[ChartPoint]] = {}
                for by in study.shown(spec, spec.by):
                    points = []
                    for x in study.shown(spec, spec.x):
                        at = tuple(
                            0 if name is None else index_of(study.values(name), value)
                            for name, value in ((spec.panels, panel), (spec.by, by), (spec.x, x))
                        )
                        levels = order.get(int(np.ravel_multi_index(at, shape)), ())
                        if levels and np.isfinite(found.value[at]):
                            value, low, high = (float(e[at]) for e in (found.value, found.low, found.high))
                            points.append(ChartPoint(x, value, low, high, int(found.n_worlds[at]), levels))
                    name = label(measure) if spec.by is None else value_label(spec.by, by)
                    series[name] = points
                where = "" if spec.panels is None else value_label(spec.panels, panel)
                title = ": ".join(filter(None, (spec.title, where, label(measure))))
                text = caption(study, spec).replace("Bands:", "Upright lines:")
                charts.append(Chart(title, text, factor_label(spec.x), label(measure), spec.x_scale, series))
        return charts

    def worlds(self, levels: Sequence[int]) -> list[WorldResult]:
        """Return the worlds of some levels with the means over their vehicles, by level and seed."""
        measures = [name for name in ("arrived", "strikes", "length_m") if name in self.study.table]
        table = self.study.table
        rows = table[table["level"].isin(list(levels))]
        means = rows.groupby(["level", "seed"])[measures].mean()
        return [
            WorldResult(level, seed, dict(zip(measures, map(float, values), strict=True)))
            for (level, seed), values in zip(means.index.tolist(), means.to_numpy(), strict=True)
        ]

    def headings(self, levels: Sequence[int]) -> tuple[str, list[str]]:
        """Return what some levels have in common, and what is different in each, in words."""
        values = [self.experiment.levels[level].values for level in levels]
        common = {name for name in values[0] if len({value[name] for value in values}) == 1}
        texts = [
            [
                ", ".join(value_label(name, v[name]) for name in v if (name in common) == is_common)
                for v in values
            ]
            for is_common in (True, False)
        ]
        return texts[0][0], texts[1]

    def _mission(self, level: int, seed: int) -> Timeline:
        """Return a mission, flown again, with a word on whether its results are those of the study.

        Raises ValueError and IndexError for a mission that the study has not.
        """
        table = self.study.table
        rows = table[(table["level"] == level) & (table["seed"] == seed)].set_index("uav")
        if rows.empty or not self.has_missions:
            raise ValueError(f"the study has no mission of level {level} and seed {seed}")
        scenario = build(self.experiment.setups[level].config)
        timeline, result = replayed(scenario, World.drawn(scenario, seed))
        different = [
            f"vehicle {row.uav}: {name} is {value_text(getattr(row, name))}, "
            f"in the results {value_text(rows[name][row.uav])}"
            for row in result.rows
            for name in COMPARED
            if not np.isclose(float(getattr(row, name)), float(rows[name][row.uav]))
        ]
        equal = "its results are those of the study"
        text = equal if not different else f"DIFFERS from the study ({different[0]}) [mission-differs]"
        timeline.text = f"{text}; {timeline.text}"
        return timeline


def option_of(chart: Chart, colours: Sequence[str]) -> dict[str, Any]:
    """Return a chart for ECharts: a line a series, an upright line an interval."""
    values = [point.x for points in chart.series.values() for point in points]
    is_numeric = all(isinstance(x, int | float) and not isinstance(x, bool) for x in values)
    axis: dict[str, Any] = {"name": chart.x, "nameLocation": "middle", "nameGap": 28, "scale": True}
    if is_numeric:
        axis["type"] = "log" if chart.x_scale == "log" else "value"
    else:
        axis |= {"type": "category", "data": list(dict.fromkeys(map(value_words, values)))}
    symbols = ("circle", "rect", "triangle", "diamond", "pin", "arrow")
    series = []
    for i, (name, points) in enumerate(chart.series.items()):
        places = [point.x if is_numeric else value_words(point.x) for point in points]
        intervals = [
            [{"coord": [x, point.low], "symbol": "none"}, {"coord": [x, point.high], "symbol": "none"}]
            for x, point in zip(places, points, strict=True)
            if np.isfinite(point.low) and np.isfinite(point.high)
        ]
        colour = colours[i % len(colours)]
        series.append(
            {
                "name": name,
                "type": "line",
                "symbol": symbols[i % len(symbols)],
                "symbolSize": 11,
                "color": colour,
                "data": [[x, point.value] for x, point in zip(places, points, strict=True)],
                "markLine": {
                    "silent": True,
                    "animation": False,
                    "lineStyle": {"type": "solid", "width": 2, "color": colour},
                    "data": intervals,
                },
            }
        )
    limits = [limit for points in chart.series.values() for p in points for limit in (p.low, p.high, p.value)]
    known = [limit for limit in limits if np.isfinite(limit)]
    spare = 0.05 * (max(known) - min(known)) if known else 0.0
    vertical = {"type": "value", "name": chart.y, "nameLocation": "middle", "nameGap": 52, "scale": True}
    if known and spare > 0.0:
        # ECharts leaves out a line that ends outside the axis, so the axis holds every interval.
        vertical |= {"min": min(known) - spare, "max": max(known) + spare}
        vertical["axisLabel"] = {"showMinLabel": False, "showMaxLabel": False}
    return {
        "animation": False,
        "legend": {"top": 0, "show": len(series) > 1},
        "tooltip": {"trigger": "item"},
        "grid": {"left": 76, "right": 24, "top": 36 if len(series) > 1 else 12, "bottom": 48},
        "xAxis": axis,
        "yAxis": vertical,
        "series": series,
    }
