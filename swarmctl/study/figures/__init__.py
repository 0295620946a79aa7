"""Figures of a study: a kind is one file, and one line in `FIGURES`.

Figures read only the results folder. Begin with `base` and `lines`. Matplotlib takes a second to import, so
callers import this package only to check or draw figures.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure
from pydantic import ValidationError

from swarmctl.study.figures import calibration, differences, dots, lines, tracks, tradeoff
from swarmctl.study.figures.base import FigureKind, Spec, Study, check_names

FIGURES: Mapping[str, FigureKind] = {
    "lines": FigureKind(lines.Lines, lines.draw, lines.caption),
    "differences": FigureKind(differences.Differences, differences.draw, differences.caption),
    "tradeoff": FigureKind(tradeoff.Tradeoff, tradeoff.draw, tradeoff.caption),
    "dots": FigureKind(dots.Dots, dots.draw, dots.caption),
    "tracks": FigureKind(tracks.Tracks, tracks.draw, tracks.caption),
    "calibration": FigureKind(calibration.Calibration, calibration.draw, calibration.caption),
}


def validate(
    spec: Mapping[str, Any], factors: Mapping[str, Sequence[object]], measures: Collection[str]
) -> Spec:
    """Return an entry of `figures:`, checked. Raises ValueError with a sentence on what is wrong.

    `factors` are the columns of factors with their values in order, `measures` the columns of measures.
    """
    kind = str(spec.get("kind"))
    if kind not in FIGURES:
        raise ValueError(f"{kind!r} is no kind of figure; the kinds are: {', '.join(FIGURES)}")
    try:
        found = FIGURES[kind].spec.model_validate(dict(spec))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"])) or "figure"
        raise ValueError(f"figure `{kind}`, key `{key}`: {first['msg']}") from error
    try:
        check_names(found, factors, measures)
    except ValueError as error:
        raise ValueError(f"figure `{kind}`: {error}") from error
    return found


def draw(study: Study, spec: Spec) -> Figure:
    """Return the figure. Raises ValueError if the results lack what it needs."""
    return FIGURES[spec.kind].draw(study, spec)


def caption(study: Study, spec: Spec) -> str:
    """Return the caption: the text of the specification, then what is drawn and how intervals are made."""
    written = FIGURES[spec.kind].caption(study, spec)
    return f"{spec.caption} {written}" if spec.caption else written
