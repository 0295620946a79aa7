"""The difference between two pictures, as plain data for a page: only what has changed. Pure.

A page keeps what it has, and replaces what it gets. Of tracks and strikes it gets the new end, with the
index at which it begins; so a page whose list is longer, after a scrub back, cuts it first.

| key | content |
|---|---|
| `vehicles` | {name: {field: value}}; `track`: {from, points} |
| `whose` | the vehicle with the belief that is shown; empty: all vehicles together |
| `belief` | cells or all codes |
| `hearing`, `conflicts`, `groups` | the whole list |
| `strikes` | {from, items} |

A belief is {cells: [index, code, index, code, …]} with index = row · cols + col, or {codes: base64 of a byte
a cell, row after row}, whichever is shorter.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from swarmctl.dashboard.history import Grown
from swarmctl.dashboard.picture import CellCodes, Picture, VehiclePicture

_FIELDS = ("position", "height_m", "heading_deg", "age_s", "is_silent", "route")
"""what the map shows of a vehicle, besides its track"""
_DIGITS = {"height_m": 1, "heading_deg": 0, "age_s": 1}
"""decimals of numbers that change all the time; finer changes are not sent"""
BYTES_A_CELL = 10
"""approximate length of a changed cell as JSON; a whole belief takes 4 bytes for 3 cells"""


def changes(before: Picture | None, after: Picture) -> dict[str, Any]:
    """Return what a page has to be sent that shows `before`; None: a page that shows nothing yet."""
    result: dict[str, Any] = {}
    shown = {} if before is None else {vehicle.name: vehicle for vehicle in before.vehicles}
    vehicles = {v.name: changed for v in after.vehicles if (changed := _vehicle(shown.get(v.name), v))}
    if vehicles:
        result["vehicles"] = vehicles
    for name in ("hearing", "conflicts", "groups"):
        items = getattr(after, name)
        if before is None or items != getattr(before, name):
            result[name] = _rounded_list(items)
    new = _growth(None if before is None else before.strikes, after.strikes)
    if new is not None:
        result["strikes"] = {"from": new, "items": msgspec.to_builtins(list(after.strikes[new:]))}
    if before is None or before.whose != after.whose:
        result["whose"] = after.whose
    belief = _belief(None if before is None else before.belief, after.belief)
    if belief is not None:
        result["belief"] = belief
    return result


def _vehicle(before: VehiclePicture | None, after: VehiclePicture) -> dict[str, Any]:
    changed: dict[str, Any] = {}
    for field in _FIELDS:
        value = getattr(after, field)
        if before is not None and (value is (old := getattr(before, field)) or value == old):
            continue
        rounded = _rounded(field, value)
        if before is None or rounded != _rounded(field, getattr(before, field)):
            changed[field] = rounded
    new = _growth(None if before is None else before.track, after.track)
    if new is not None:
        points = [[round(east, 1), round(north, 1)] for east, north in after.track[new:]]
        changed["track"] = {"from": new, "points": points}
    return changed


def _rounded(field: str, value: Any) -> Any:
    if value is None:
        return None
    if field in _DIGITS:
        return round(value, _DIGITS[field])
    if field == "position":
        return [round(value[0], 1), round(value[1], 1)]
    return msgspec.to_builtins(value) if isinstance(value, msgspec.Struct) else value


def _rounded_list(items: Sequence[msgspec.Struct]) -> list[dict[str, Any]]:
    """Return hearing edges, conflicts or groups with numbers that a page can show."""
    return [
        {
            key: (round(value, 2 if key == "loss" else 0) if isinstance(value, float) else value)
            for key, value in msgspec.structs.asdict(item).items()
        }
        for item in items
    ]


def _growth(before: Grown[Any] | None, after: Grown[Any]) -> int | None:
    """Return the index from which on `after`, another part of the same list, is new; None if nothing is."""
    if before is None:
        return 0
    return None if len(before) == len(after) else min(len(before), len(after))


def _belief(before: CellCodes | None, after: CellCodes) -> dict[str, Any] | None:
    """Return the changes of a belief, which may be another vehicle's than before; None if there are none."""
    if before is not None:
        cells = np.flatnonzero(before != after)
        if not cells.size:
            return None
        if BYTES_A_CELL * cells.size < after.size:
            return {"cells": np.stack([cells, after.ravel()[cells]], axis=1).ravel().tolist()}
    return {"codes": base64.b64encode(after.tobytes()).decode()}
