"""Figure `lines`: measures along a factor, one line for each value of another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from matplotlib.figure import Figure
from pydantic import Field

from swarmctl.study.figures.base import Names, Spec, Study, factors_of, interval_text, require_log_values
from swarmctl.study.figures.marks import draw_lines, name_values
from swarmctl.study.figures.measures import estimate, factor_label, label
from swarmctl.study.figures.panels import estimates_of, panels_of
from swarmctl.study.figures.style import set_unit


class Lines(Spec):
    x: str = Field(description="Factor on the horizontal axis.")
    y: Names = Field(description="Measures, one panel each.")
    by: str | None = Field(None, description="Factor with one line for each value.")
    x_scale: Literal["linear", "log"] = Field("linear", description="Scale of the horizontal axis.")

    def factors(self) -> set[str]:
        return factors_of(self.x, self.by, self.panels)

    def measures(self) -> set[str]:
        return set(self.y)

    def check(self, factors: Mapping[str, Sequence[object]]) -> None:
        if self.x_scale == "log":
            require_log_values(self.x, factors[self.x])


def draw(study: Study, spec: Lines) -> Figure:
    figure, panels = panels_of(study, spec, spec.y)
    by, x = study.shown(spec, spec.by), (spec.x, study.shown(spec, spec.x))
    for panel in panels:
        found = estimates_of(study, spec, panel, (spec.by, spec.x), estimate)
        set_unit(panel.axes.yaxis, panel.measure)
        draw_lines(panel.axes, x, by, found, spec.x_scale)
    name_values(figure, spec.by, by)
    return figure


def caption(study: Study, spec: Lines) -> str:
    by = f", one line for each value of {factor_label(spec.by)}" if spec.by else ""
    names = "; ".join(label(name) for name in spec.y)
    return f"Mean {names} by {factor_label(spec.x)}{by}. Bands: {interval_text(study, spec.y)}"
