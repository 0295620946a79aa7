"""Figure `dots`: measures of the values of a factor without order, such as planners."""

from __future__ import annotations

from matplotlib.figure import Figure
from pydantic import Field

from swarmctl.study.figures.base import Names, Spec, Study, factors_of, interval_text
from swarmctl.study.figures.marks import draw_rows, name_values
from swarmctl.study.figures.measures import estimate, factor_label, label
from swarmctl.study.figures.panels import estimates_of, panels_of
from swarmctl.study.figures.style import columns_of, fit, set_unit


class Dots(Spec):
    x: str = Field(description="Factor with one row for each value.")
    y: Names = Field(description="Measures, one panel each.")
    by: str | None = Field(None, description="Factor with one mark in each row for each value.")

    def factors(self) -> set[str]:
        return factors_of(self.x, self.by, self.panels)

    def measures(self) -> set[str]:
        return set(self.y)


def draw(study: Study, spec: Dots) -> Figure:
    by, x = study.shown(spec, spec.by), (spec.x, study.shown(spec, spec.x))
    figure, panels = panels_of(study, spec, spec.y, height_mm(len(x[1]), len(by)), most_columns=4)
    for panel in panels:
        found = estimates_of(study, spec, panel, (spec.by, spec.x), estimate)
        set_unit(panel.axes.xaxis, panel.measure)
        draw_rows(panel.axes, x, by, found, named=columns_of(panel.axes)[0] == 0)
    name_values(figure, spec.by, by)
    fit(figure)
    return figure


def height_mm(n_rows: int, n_series: int) -> float:
    """Return the height of a panel with rows of dots."""
    return 16.0 + n_rows * max(5.0, 2.6 * n_series)


def caption(study: Study, spec: Dots) -> str:
    names = "; ".join(label(name) for name in spec.y)
    return f"Mean {names} by {factor_label(spec.x)}. Lines: {interval_text(study, spec.y)}"
