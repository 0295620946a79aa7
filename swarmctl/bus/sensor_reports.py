"""Reports of a payload to its vehicle's agent, as JSON: cells of the area with and without a hostile.

A report is one observation with these fields:

| field | type | meaning |
|---|---|---|
| `version` | 1 | version of this table |
| `cells` | list of [row, col, occupied] | observed cells; row 0 is the southernmost, col 0 the westernmost |
| `points` | list of {lat_deg, lon_deg, occupied} | instead of `cells`: positions, WGS-84 [deg] |
| `unix_s` | number, optional | time of the observation, by the payload's clock [s] |
| `source` | text, optional | the payload's name, for logs; up to 32 printable characters |

`occupied` is true if a hostile is in the cell, and false if the cell is clear; unobserved cells are left out.
Points in one cell count once, and must agree. Unknown fields are ignored.

Each report counts as a separate observation, with independent errors `sensor.p_miss` and
`sensor.p_false_alarm`. So a payload reports a cell once per pass, not once per picture.

A report is accepted or refused as a whole. A query, unlike a put, gets an answer:
`{"taken": true, "cells": [[4,7,true]]}` or `{"taken": false, "why": "..."}`.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, Final, Literal

import msgspec

from swarmctl.core.grid import Cell, Grid

VERSION: Final = 1
MAX_BYTES = 16_384
"""greatest size of a report, enough for about 1400 cells"""
MAX_CELLS = 4096
MAX_SOURCE_CHARS = 32
MANUAL_SOURCE = "operator"
"""`source` of the reports that a person sends with `swarmctl observe`"""
MAX_AGE_S = 60.0
"""largest age of a report: the hostile may have moved, or the payload's clock may be wrong"""
CLOCK_TOLERANCE_S = 5.0
"""largest lead of a payload's clock"""

ReportedCells = tuple[tuple[int, int, bool], ...]
"""(row, col, occupied) of each cell"""


class RejectReason(StrEnum):
    """Reason for a refusal; the messages begin with it."""

    MALFORMED = "malformed"
    OVERSIZE = "oversize"
    VERSION = "other version"
    OUTSIDE = "outside the area"
    TWICE = "same cell twice"
    STALE = "too old"
    FUTURE = "from the future"
    KEY = "wrong key"
    UNSIGNED = "not authenticated"
    TOO_FAST = "too fast"


class RejectedReport(ValueError):
    """A refused report."""

    def __init__(self, reason: RejectReason, text: str) -> None:
        super().__init__(f"{reason}: {text}")
        self.reason = reason


class ReportedPoint(msgspec.Struct, frozen=True):
    """An observed position."""

    lat_deg: Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
    occupied: bool


_OneOrMore = msgspec.Meta(min_length=1, max_length=MAX_CELLS)


class Report(msgspec.Struct, frozen=True, omit_defaults=True):
    """One observation of a payload."""

    version: Annotated[Literal[1], msgspec.Meta(description="version of this schema")]
    cells: Annotated[ReportedCells, _OneOrMore] | None = None
    points: Annotated[tuple[ReportedPoint, ...], _OneOrMore] | None = None
    unix_s: float | None = None
    source: Annotated[str, msgspec.Meta(max_length=MAX_SOURCE_CHARS)] = ""


class ReportAnswer(msgspec.Struct, frozen=True, omit_defaults=True):
    """Answer to a report."""

    taken: bool
    cells: ReportedCells = ()
    """accepted cells"""
    why: str = ""


class _Versioned(msgspec.Struct):
    version: int


_version_decoder = msgspec.json.Decoder(_Versioned)
_report_decoder = msgspec.json.Decoder(Report)
_answer_decoder = msgspec.json.Decoder(ReportAnswer)
_encoder = msgspec.json.Encoder()


def report_schema() -> dict[str, Any]:
    either = [{"required": ["cells"]}, {"required": ["points"]}]
    dialect = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": dialect, **msgspec.json.schema(Report), "oneOf": either}


def encode(content: Report | ReportAnswer) -> bytes:
    return _encoder.encode(content)


def decode_answer(data: bytes) -> ReportAnswer:
    """Return the answer to a report. Raises ValueError, and no other exception, for malformed bytes."""
    try:
        return _answer_decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"expected an answer to a report: {error}") from None


def decode_report(
    data: bytes, grid: Grid, now_unix_s: float, tolerance_s: float = CLOCK_TOLERANCE_S
) -> tuple[ReportedCells, str]:
    """Return the cells of a report, and its source.

    Raises RejectedReport, and no other exception, for an invalid report.
    """
    if len(data) > MAX_BYTES:
        raise RejectedReport(
            RejectReason.OVERSIZE, f"{len(data)} bytes, expected at most {MAX_BYTES}: send several reports"
        )
    report = _decode_json(data)
    if not report.source.isprintable():
        raise RejectedReport(RejectReason.MALFORMED, "`source` has unprintable characters")
    if report.unix_s is not None:
        _check_time(now_unix_s - report.unix_s, tolerance_s)
    if report.cells is not None and report.points is None:
        return _check_cells(report.cells, grid), report.source
    if report.points is not None and report.cells is None:
        return _cells_of_points(report.points, grid), report.source
    found = "neither" if report.cells is None else "both"
    raise RejectedReport(RejectReason.MALFORMED, f"expected `cells` or `points`, found {found}")


def _decode_json(data: bytes) -> Report:
    try:
        version = _version_decoder.decode(data).version
        if version != VERSION:
            raise RejectedReport(
                RejectReason.VERSION, f"expected version {VERSION}, found {str(version)[:20]}"
            )
        return _report_decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RejectedReport(
            RejectReason.MALFORMED, f"{error}; `swarmctl observe --schema` prints the schema"
        ) from None


def _check_time(age_s: float, tolerance_s: float) -> None:
    if age_s > MAX_AGE_S:
        raise RejectedReport(
            RejectReason.STALE,
            f"the observation is {age_s:.1f} s old (limit {MAX_AGE_S:g} s); check the payload's clock",
        )
    if age_s < -tolerance_s:
        raise RejectedReport(
            RejectReason.FUTURE,
            f"the observation is {-age_s:.1f} s in the future (limit {tolerance_s:g} s); check the payload's "
            "clock",
        )


def _check_cells(cells: ReportedCells, grid: Grid) -> ReportedCells:
    observed: set[Cell] = set()
    for row, col, _ in cells:
        if not grid.contains((row, col)):
            raise RejectedReport(
                RejectReason.OUTSIDE,
                f"cell [{str(row)[:20]}, {str(col)[:20]}]: expected row 0 to {grid.rows - 1} and col 0 to "
                f"{grid.cols - 1}",
            )
        if (row, col) in observed:
            raise RejectedReport(RejectReason.TWICE, f"cell [{row}, {col}]; list each cell once")
        observed.add((row, col))
    return cells


def _cells_of_points(points: tuple[ReportedPoint, ...], grid: Grid) -> ReportedCells:
    observed: dict[Cell, bool] = {}
    for point in points:
        cell = grid.cell_at(point.lat_deg, point.lon_deg)
        if cell is None:
            raise RejectedReport(
                RejectReason.OUTSIDE,
                f"point {point.lat_deg:.7f}, {point.lon_deg:.7f} lies in no cell of the area",
            )
        if observed.setdefault(cell, point.occupied) != point.occupied:
            raise RejectedReport(
                RejectReason.TWICE,
                f"cell [{cell[0]}, {cell[1]}] has occupied and clear points: a cell is clear only if the "
                "whole cell is clear",
            )
    return tuple((row, col, occupied) for (row, col), occupied in observed.items())
