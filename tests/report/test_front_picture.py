from __future__ import annotations

import math
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text

from swarmctl.core.grid import Grid
from swarmctl.core.records import replace
from swarmctl.report.pictures.front import colours, draw_fronts, front_figure
from swarmctl.report.pictures.panel import FrontBound, FrontPanel, FrontPoint

GRID = Grid(20, 20, 50.0, 46.0, 14.4)


def panel(n: int = 5, name: str = "uav1", **changes: object) -> FrontPanel:
    """Return a front of n routes from 950 m on, every third inside the hull; the second is configured."""
    start = GRID.frame.to_geodetic(-60.0, 525.0)
    exposure = np.full((20, 20), 0.132)
    exposure[5, 5] = math.inf
    points = [
        FrontPoint(
            950.0 + 40.0 * k, 3.0 / (1 + k) + 1.0, k % 3 != 2, [start, GRID.centre((10, k % 20)), start]
        )
        for k in range(n)
    ]
    chosen = points[min(1, n - 1)]
    made = FrontPanel(
        name=name,
        about=f"{n} routes",
        points=points,
        exposure=exposure,
        start=start,
        goal_cells=[(10, 19)],
        entry_s=22.0,
        speed_m_s=10.0,
        chosen=(chosen.length_m, chosen.exposure_sum),
        chosen_label="constrained",
        bounds=[FrontBound(1100.0, "within 132 s", is_latest=True)],
    )
    return replace(made, **changes)


def drawn(*panels: FrontPanel) -> Figure:
    figure = front_figure(GRID, panels, "first-flight: what length buys", "5 vehicles at take-off")
    figure.draw_without_rendering()
    return figure


def charts(figure: Figure) -> list[Axes]:
    """Return the chart of each vehicle; the legend is first, then chart and map of each vehicle."""
    return figure.axes[1::2]


def marks(axes: Axes) -> list[tuple[float, float, str]]:
    """Return (x, y, face) of every point of a chart, without the ring around the configured route."""
    lines = [line for line in axes.lines if line.get_marker() == "o" and line.get_markersize() < 8.0]
    return [
        (float(line.get_xdata()[0]), float(line.get_ydata()[0]), str(line.get_markerfacecolor()))
        for line in lines
    ]


def test_every_route_is_a_point_and_a_line_joins_those_of_the_hull() -> None:
    shown = panel(9)
    (chart,) = charts(drawn(shown))
    found = marks(chart)
    assert [(x, y) for x, y, _ in found] == [(p.length_m, p.exposure_sum) for p in shown.points]
    assert [face != "white" for _, _, face in found] == [p.supported for p in shown.points]
    (hull,) = [line for line in chart.lines if line.get_marker() == "None" and line.get_linestyle() == "-"]
    assert list(hull.get_xdata()) == [p.length_m for p in shown.points if p.supported]


def test_chart_and_map_show_a_route_in_one_colour() -> None:
    shown = panel(6)
    figure = drawn(shown)
    faces = [face for _, _, face in marks(charts(figure)[0])]
    tracks = [line for line in figure.axes[2].lines if line.get_marker() == "None"]
    on_map = [str(line.get_color()) for line in reversed(tracks)]
    assert on_map == colours(6)
    assert [face for face in faces if face != "white"] == [
        colour for colour, p in zip(colours(6), shown.points, strict=True) if p.supported
    ]
    assert len({to_rgb(colour) for colour in colours(6)}) == 6


def test_the_configured_route_the_bound_and_the_time_are_marked() -> None:
    shown = panel()
    (chart,) = charts(drawn(shown))
    (ring,) = [line for line in chart.lines if line.get_marker() == "o" and line.get_markersize() > 8.0]
    assert (ring.get_xdata()[0], ring.get_ydata()[0]) == shown.chosen
    (bound,) = [line for line in chart.lines if line.get_linestyle() == "--"]
    low, high = chart.get_xlim()
    assert low < bound.get_xdata()[0] == 1100.0 < high
    assert {"constrained", "within 132 s"} <= {text.get_text() for text in chart.texts}
    (seconds,) = chart.child_axes
    assert seconds.get_xlim() == pytest.approx([22.0 + edge / 10.0 for edge in (low, high)])


OFF = [GRID.centre((3, col)) for col in (0, 9, 19)]
"""a track that is not on the front"""


def test_a_configured_route_off_the_front_is_drawn_on_the_map_and_filled_in_the_chart() -> None:
    figure = drawn(panel(3, chosen=(1400.0, 6.0), chosen_track=OFF))
    dashed = [line for line in figure.axes[2].lines if line.get_linestyle() == "--"]
    assert [len(line.get_xdata()) for line in dashed] == [3]
    assert [(x, y) for x, y, _ in marks(charts(figure)[0])][-1] == (1400.0, 6.0)
    on_it = drawn(panel(3))
    assert not [line for line in on_it.axes[2].lines if line.get_linestyle() == "--"]


@pytest.mark.parametrize("exposure", [0.0, 1e-9, 17.5])
def test_a_front_of_one_route_is_labelled_and_shows_its_exposure(exposure: float) -> None:
    shown = panel(1, points=[FrontPoint(950.0, exposure, True)], chosen=(950.0, exposure))
    (chart,) = charts(drawn(shown))
    (of_two,) = charts(drawn(panel(2)))
    n_labels = len(of_two.texts)
    assert len(chart.texts) == n_labels + 1
    low, high = chart.get_ylim()
    assert low < 0.0 <= exposure < high
    assert -low < 0.2 * high


def test_a_bound_far_beyond_the_front_does_not_squeeze_it() -> None:
    (chart,) = charts(drawn(panel(bounds=[FrontBound(90_000.0, "within 9000 s", is_latest=True)])))
    assert chart.get_xlim()[1] < 2_000.0
    assert "within 9000 s" not in {text.get_text() for text in chart.texts}


def texts_of(figure: Figure) -> list[Text]:
    every = [axes for top in figure.axes for axes in (top, *top.child_axes)]
    found = [text for axes in every for text in axes.texts]
    for axes in every:
        found += [axes.xaxis.label, axes.yaxis.label]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval()
            found += [tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
            found += [tick.label2 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
    return [text for text in [*found, *figure.texts] if text.get_text() and text.get_visible()]


SHEETS = [
    ("one vehicle", [panel()]),
    ("one route", [panel(1)]),
    ("one route and another configured", [panel(1, chosen=(1400.0, 6.0), chosen_track=OFF)]),
    ("one route without any threat", [panel(1, points=[FrontPoint(950.0, 0.0, True)], chosen=(950.0, 0.0))]),
    ("one route each", [panel(1)] * 3),
    ("two hundred routes", [panel(200)]),
    ("five vehicles", [panel(4 + k, f"uav{k + 1}") for k in range(5)]),
    (
        "names as long as they may be",
        [panel(3, "a-name-as-long-as-a-name-may-be..", about="12345 routes, 1234 on the hull; cut off")] * 2,
    ),
    ("nothing inside the hull", [panel(2)]),
    ("no bound", [panel(bounds=[])]),
]


@pytest.mark.full
@pytest.mark.parametrize("panels", [s[1] for s in SHEETS], ids=[s[0] for s in SHEETS])
def test_no_label_overlaps_another_or_is_cut_off(panels: list[FrontPanel]) -> None:
    figure = drawn(*panels)
    wide, high = figure.bbox.width, figure.bbox.height
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts_of(figure)]
    for text, box in boxes:
        assert 0 <= box.x0 <= box.x1 <= wide, text
        assert 0 <= box.y0 <= box.y1 <= high, text
    for (text, box), (other_text, other) in combinations(boxes, 2):
        assert not box.overlaps(other), (text, other_text)


def test_equal_fronts_give_equal_bytes(tmp_path: Path) -> None:
    for name, shown in (("one", panel()), ("two", panel()), ("other", panel(6))):
        draw_fronts(tmp_path / name, GRID, [shown], "title", "subtitle")
    one = (tmp_path / "one").read_bytes()
    assert one.startswith(b"\x89PNG")
    assert one == (tmp_path / "two").read_bytes()
    assert one != (tmp_path / "other").read_bytes()
