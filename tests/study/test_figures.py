"""Figures: refused specifications, letters that do not collide, and files for print."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import made_up_study
import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.image import imread
from matplotlib.text import Annotation

from swarmctl.study.figures import caption, draw, validate
from swarmctl.study.figures.base import Study
from swarmctl.study.figures.calibration import Calibration, binned
from swarmctl.study.figures.style import HEADING, files, print_style

KEYS = {"level", "seed", "uav"}
PLANNERS = ["dijkstra", "time_bound", "constrained", "survival", "any_angle"]
W = [0.0, 0.25, 0.5, 0.75, 1.0]
N, K, NAMES = "simulate.count", "communication.range", "planner.name"
N_AND_K = {N: [2, 5, 10], K: [0, 1, 2, "all"]}
SECTIONS = ['{"name": "dijkstra", "w": 0.5}', '{"name": "survival"}']
NAMES_AND_W = {NAMES: PLANNERS, "planner.w": W}
AGAINST_SILENCE = {"kind": "differences", "compare": K, "reference": 0, "by": N}
CASES: dict[str, tuple[dict[str, list[Any]], dict[str, Any]]] = {
    "lines": (N_AND_K, {"kind": "lines", "x": K, "y": ["strikes", "survived"], "by": N}),
    "lines of names": (NAMES_AND_W, {"kind": "lines", "x": "planner.w", "y": "length_cells", "by": NAMES}),
    "lines, three panels": (
        NAMES_AND_W,
        {
            "kind": "lines", "x": "planner.w", "y": ["strikes", "strikes_per_km", "mission_strikes"],
            "by": NAMES, "width": "two",
        },
    ),
    "panels": (N_AND_K, {"kind": "lines", "x": K, "y": "strikes", "panels": N, "width": "two"}),
    "differences": (N_AND_K, {**AGAINST_SILENCE, "y": "strikes"}),
    "savings": (N_AND_K, {**AGAINST_SILENCE, "y": "mission_strikes", "per": "messages_sent"}),
    "a logarithmic axis without the reference 0": (
        {"planner.w": W},
        {"kind": "differences", "compare": "planner.w", "reference": 0, "y": "strikes", "x_scale": "log"},
    ),
    "differences along": (
        NAMES_AND_W,
        {"kind": "differences", "compare": NAMES, "reference": "dijkstra", "x": "planner.w", "y": "strikes"},
    ),
    "differences of names": (
        NAMES_AND_W,
        {"kind": "differences", "compare": "planner.w", "reference": 0, "x": NAMES, "y": "strikes"},
    ),
    "tradeoff": (
        {"planner.w": W},
        {"kind": "tradeoff", "x": "length_cells", "y": ["exposure_sum", "strikes"], "along": "planner.w"},
    ),
    "tradeoff of a curve that rises": (
        {"planner.w": W}, {"kind": "tradeoff", "x": "exposure_sum", "y": "strikes", "along": "planner.w"},
    ),
    "tradeoff of curves": (
        NAMES_AND_W,
        {"kind": "tradeoff", "x": "length_cells", "y": "strikes", "along": "planner.w", "by": NAMES},
    ),
    "tradeoff of names": (
        {NAMES: PLANNERS}, {"kind": "tradeoff", "x": "length_cells", "y": "strikes", "by": NAMES},
    ),
    "dots": (
        {NAMES: PLANNERS},
        {"kind": "dots", "x": NAMES, "y": ["length_cells", "strikes", "survived"], "width": "two"},
    ),
    "dots by": (
        {NAMES: PLANNERS, "planner.w": [0.0, 1.0]},
        {"kind": "dots", "x": NAMES, "y": "strikes", "by": "planner.w"},
    ),
    "dots of sections, panels": (
        {"planner": SECTIONS, "simulate.delay_step_s": [0, 20]},
        {"kind": "dots", "x": "planner", "y": ["strikes", "survived"], "panels": "simulate.delay_step_s"},
    ),
    "tracks": ({"planner.w": [1.0, 0.5, 0.0]}, {"kind": "tracks", "panels": "planner.w", "width": "two"}),
    "calibration": (
        {"planner.w": [0.0, 1.0]}, {"kind": "calibration", "predicted": "safety_factor", "by": "planner.w"},
    ),
}  # fmt: skip


def study_of(factors: dict[str, list[Any]], n_worlds: int = 12) -> Study:
    table = made_up_study.rows(factors, n_worlds)
    measures = [name for name in table.columns if name not in KEYS | factors.keys()]
    return Study(table, factors, measures, (20, 20), *made_up_study.tracks(table))


@pytest.mark.parametrize(("name", "n_worlds"), [*((name, 12) for name in CASES), ("tradeoff", 1000)])
def test_letters_stay_on_the_page_and_apart(name: str, n_worlds: int) -> None:
    factors, entry = CASES[name]
    study = study_of(factors, n_worlds)
    spec = validate(entry, factors, study.measures)
    with print_style():
        figure = draw(study, spec)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        texts = [text for text in figure.findobj(Annotation) if text.get_text().strip()]
        texts += figure.findobj(lambda artist: artist.get_label() == HEADING)
        texts += [text for legend in figure.legends for text in legend.get_texts()]
        labels = [text.get_window_extent().shrunk(0.9, 0.9) for text in texts]
    assert round(figure.get_size_inches()[0] * 25.4) == (180 if entry.get("width") == "two" else 88)
    image = np.asarray(canvas.buffer_rgba())[..., :3]
    assert all((edge == 255).all() for edge in (image[0], image[-1], image[:, 0], image[:, -1]))
    assert not any(a.overlaps(b) for a, b in itertools.combinations(labels, 2))
    assert "interval" in caption(study, spec)
    n_named = sum(len(legend.get_texts()) for legend in figure.legends)
    assert "by" not in entry or n_named == len(factors[entry["by"]])


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "no such kind": ({"kind": "pie"}, "lines"),
    "no such key": ({"kind": "lines", "x": "planner.w", "y": "strikes", "colour": "red"}, "colour"),
    "no such factor": ({"kind": "lines", "x": "planner.z", "y": "strikes"}, "planner.z"),
    "no such measure": ({"kind": "lines", "x": "planner.w", "y": "misses"}, "misses"),
    "no measure": ({"kind": "lines", "x": "planner.w", "y": []}, "y"),
    "a factor passed over": ({"kind": "lines", "x": "planner.w", "y": "strikes"}, "simulate.count"),
    "no such value": ({"kind": "lines", "x": "planner.w", "y": "strikes", "where": {N: 3}}, N),
    "no such reference": (
        {"kind": "differences", "compare": "planner.w", "reference": 2, "y": "strikes", "by": N},
        "planner.w",
    ),
    "zero on a logarithmic axis": (
        {"kind": "lines", "x": "planner.w", "y": "strikes", "by": N, "x_scale": "log"}, "planner.w",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_wrong_figure_is_refused_before_the_first_mission(name: str) -> None:
    spec, named = REFUSED[name]
    with pytest.raises(ValueError, match=named):
        validate(spec, {"planner.w": [0.0, 1.0], "simulate.count": [2, 5]}, ["strikes"])


def test_means_over_a_factor_are_drawn_if_the_figure_says_so() -> None:
    entry = {"kind": "lines", "x": "planner.w", "y": "strikes", "over": "simulate.count"}
    assert validate(entry, {"planner.w": [0.0, 1.0], "simulate.count": [2, 5]}, ["strikes"]).over == (
        "simulate.count",
    )


def test_equal_results_give_equal_files_with_embedded_letters(tmp_path: Path) -> None:
    factors, entry = CASES["tradeoff"]
    study = study_of(factors)
    for name in ("a", "b"):
        with print_style():
            files(draw(study, validate(entry, factors, study.measures)), tmp_path, name)
    for end in ("png", "pdf"):
        assert (tmp_path / f"a.{end}").read_bytes() == (tmp_path / f"b.{end}").read_bytes()
    pdf = (tmp_path / "a.pdf").read_bytes()
    assert b"/FontFile2" in pdf
    assert b"/Type3" not in pdf
    assert imread(tmp_path / "a.png").shape[1] == round(88 / 25.4 * 300)


def test_tracks_of_a_world_that_was_not_kept_are_an_error() -> None:
    factors, entry = CASES["tracks"]
    study = study_of(factors)
    spec = validate({**entry, "seed": 7}, factors, study.measures)
    with pytest.raises(ValueError, match="seed 7"), print_style():
        draw(study, spec)


def test_tracks_show_the_way_of_each_vehicle_and_its_strikes() -> None:
    factors, entry = CASES["tracks"]
    study = study_of(factors)
    with print_style():
        figure = draw(study, validate(entry, factors, study.measures))
    tracks = study.tracks
    assert tracks is not None
    for level, axes in enumerate(figure.axes):
        of_level = tracks[tracks["level"] == level].sort_values("step")
        for _, own in of_level.groupby("uav"):
            cells = own[["col", "row"]].to_numpy() + 0.5
            assert any(
                line.get_xydata().shape == cells.shape and np.allclose(line.get_xydata(), cells, atol=1e-6)
                for line in axes.lines
            )
        n_stars = sum(len(line.get_xdata()) for line in axes.lines if line.get_marker() == "*")
        assert n_stars == (of_level["strikes"] > 0).sum()


def test_a_true_probability_lies_on_the_diagonal() -> None:
    rng = np.random.default_rng(1)
    p = rng.random(40_000)
    columns = {"level": 0, "seed": np.arange(p.size), "uav": 0}
    columns |= {"safety_factor": p, "survived": rng.random(p.size) < p}
    study = Study(pd.DataFrame(columns), {}, ["safety_factor", "survived"], (20, 20))
    spec = Calibration(kind="calibration", predicted=("safety_factor",))
    at, found = binned(study, spec, "safety_factor", None, None)
    assert at == pytest.approx(np.arange(10) / 10 + 0.05, abs=0.005)
    assert found.value == pytest.approx(at, abs=0.025)
