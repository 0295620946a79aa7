"""What a payload reports to its vehicle's agent, as JSON: which cells of the area a hostile holds.

A report is one look, of these fields:

| field | type | means |
|---|---|---|
| `version` | 1 | of this table |
| `cells` | list of [row, col, occupied] | what was seen; row 0 is the southernmost, col 0 the westernmost |
| `points` | list of {lat_deg, lon_deg, occupied} | instead of `cells`: the same by position, WGS-84 [deg] |
| `unix_s` | number, may be left away | when it was seen, by the payload's clock [s] |
| `source` | text, may be left away | the payload's name, for logs; up to 32 printable characters |

`occupied` is true where a hostile holds the cell and false where none does: a cell of which nothing is known
is left away. Points in one cell count once, and must agree. Fields that a later version adds are ignored.

Each report counts as one more look, which errs independently of all others with `sensor.p_miss` and
`sensor.p_false_alarm`: what was seen on one way past a cell is reported once, not once a picture.

A report is taken or refused as a whole. Who asks instead of putting is told so:
`{"taken": true, "cells": [[4,7,true]]}` or `{"taken": false, "why": "..."}`.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, Final, Literal

import msgspec

from swarmctl.core.grid import Cell, Grid

VERSION: Final = 1
MAX_BYTES = 16_384
"""of a report; some 1400 cells"""
MAX_CELLS = 4096
MAX_SOURCE = 32
"""characters"""
BY_HAND = "operator"
"""the source where a person reports, by `swarmctl observe`"""
OLDEST_S = 60.0
"""what was seen longer ago may have moved, and its sender's clock may be wrong"""
CLOCK_TOLERANCE_S = 5.0
"""how far ahead a payload's clock may be"""

ReportedCells = tuple[tuple[int, int, bool], ...]
"""(row, col, occupied) of each cell"""


class RejectReason(StrEnum):
    """Why a report was refused, in a word."""

    MALFORMED = "malformed"
    OVERSIZE = "oversize"
    VERSION = "other version"
    OUTSIDE = "outside the area"
    TWICE = "same cell twice"
    STALE = "too old"
    FUTURE = "from the future"
    KEY = "wrong key"
    TOO_FAST = "too fast"


class RejectedReport(ValueError):
    """A report that is not taken; says why in a word, what was found and what was expected."""

    def __init__(self, reason: RejectReason, text: str) -> None:
        super().__init__(f"{reason}: {text}")
        self.reason = reason


class ReportedPoint(msgspec.Struct, frozen=True):
    """A place that was looked at."""

    lat_deg: Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
    occupied: bool


_Several = msgspec.Meta(min_length=1, max_length=MAX_CELLS)


class Report(msgspec.Struct, frozen=True, omit_defaults=True):
    """One look of a payload."""

    version: Annotated[Literal[1], msgspec.Meta(description="of this schema")]
    cells: Annotated[tuple[tuple[int, int, bool], ...], _Several] | None = None
    """(row, col, occupied)"""
    points: Annotated[tuple[ReportedPoint, ...], _Several] | None = None
    unix_s: float | None = None
    source: Annotated[str, msgspec.Meta(max_length=MAX_SOURCE)] = ""


class ReportAnswer(msgspec.Struct, frozen=True, omit_defaults=True):
    """What became of a report, for who asked."""

    taken: bool
    cells: ReportedCells = ()
    """what was taken"""
    why: str = ""
    """why nothing was"""


class _Versioned(msgspec.Struct):
    version: int


_versions = msgspec.json.Decoder(_Versioned)
_reports = msgspec.json.Decoder(Report)
_answers = msgspec.json.Decoder(ReportAnswer)
_encoder = msgspec.json.Encoder()


def report_schema() -> dict[str, Any]:
    """The JSON schema of reports."""
    either = [{"required": ["cells"]}, {"required": ["points"]}]
    dialect = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": dialect, **msgspec.json.schema(Report), "oneOf": either}


def encode(content: Report | ReportAnswer) -> bytes:
    return _encoder.encode(content)


def decode_answer(data: bytes) -> ReportAnswer:
    """What is said to a report. Raises ValueError; never anything else, whatever the bytes."""
    try:
        return _answers.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"no answer to a report: {error}") from None


def decode_report(
    data: bytes, grid: Grid, now_unix_s: float, tolerance_s: float = CLOCK_TOLERANCE_S
) -> tuple[ReportedCells, str]:
    """The cells of a report, and its source. Raises BadReport; never anything else, whatever the bytes."""
    if len(data) > MAX_BYTES:
        raise RejectedReport(
            RejectReason.OVERSIZE, f"{len(data)} bytes, expected at most {MAX_BYTES}: send several reports"
        )
    report = _decoded(data)
    if not report.source.isprintable():
        raise RejectedReport(RejectReason.MALFORMED, "`source` has characters that cannot be printed")
    if report.unix_s is not None:
        _check_time(now_unix_s - report.unix_s, tolerance_s)
    if report.cells is not None and report.points is None:
        return _checked(report.cells, grid), report.source
    if report.points is not None and report.cells is None:
        return _located(report.points, grid), report.source
    found = "neither" if report.cells is None else "both"
    raise RejectedReport(RejectReason.MALFORMED, f"expected `cells` or `points`, found {found}")


def _decoded(data: bytes) -> Report:
    try:
        version = _versions.decode(data).version
        if version != VERSION:
            raise RejectedReport(
                RejectReason.VERSION, f"expected version {VERSION}, found {str(version)[:20]}"
            )
        return _reports.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RejectedReport(
            RejectReason.MALFORMED, f"{error}; `swarmctl observe --schema` prints what is expected"
        ) from None


def _check_time(age_s: float, tolerance_s: float) -> None:
    if age_s > OLDEST_S:
        raise RejectedReport(
            RejectReason.STALE,
            f"seen {age_s:.1f} s ago, expected at most {OLDEST_S:g}: is the payload's clock right?",
        )
    if age_s < -tolerance_s:
        raise RejectedReport(
            RejectReason.FUTURE,
            f"seen {-age_s:.1f} s from now, expected at most {tolerance_s:g}: is the payload's clock right?",
        )


def _checked(cells: ReportedCells, grid: Grid) -> ReportedCells:
    seen: set[Cell] = set()
    for row, col, _ in cells:
        if not grid.contains((row, col)):
            raise RejectedReport(
                RejectReason.OUTSIDE,
                f"cell [{str(row)[:20]}, {str(col)[:20]}]: expected row 0 to {grid.rows - 1} and col 0 to "
                f"{grid.cols - 1}",
            )
        if (row, col) in seen:
            raise RejectedReport(RejectReason.TWICE, f"cell [{row}, {col}]: a report is one look")
        seen.add((row, col))
    return cells


def _located(points: tuple[ReportedPoint, ...], grid: Grid) -> ReportedCells:
    """The cells in which the points lie, each once."""
    seen: dict[Cell, bool] = {}
    for point in points:
        cell = grid.cell_at(point.lat_deg, point.lon_deg)
        if cell is None:
            raise RejectedReport(
                RejectReason.OUTSIDE,
                f"point {point.lat_deg:.7f}, {point.lon_deg:.7f} lies in no cell of the area",
            )
        if seen.setdefault(cell, point.occupied) != point.occupied:
            raise RejectedReport(
                RejectReason.TWICE,
                f"cell [{cell[0]}, {cell[1]}] has points that are occupied and points that are clear: a cell "
                "is clear if no part of it is held",
            )
    return tuple((row, col, occupied) for (row, col), occupied in seen.items())
