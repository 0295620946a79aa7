"""The content of a picture of fronts: a panel for each vehicle, with its routes and bounds."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell


class FrontPoint(msgspec.Struct, frozen=True):
    """One route of the front."""

    length_m: float
    exposure_sum: float
    supported: bool
    """True for a route on the convex hull of the front: a search with some w finds this route"""
    track: Sequence[LatLon] | None = None
    """the route's line on the map; None: not drawn"""


class FrontBound(msgspec.Struct, frozen=True):
    """The route length at which the arrival is at one limit of the time bound, if turns take no time."""

    length_m: float
    text: str
    is_latest: bool
    """True: longer routes arrive too late; False: shorter routes arrive too early"""


class FrontPanel(msgspec.Struct, frozen=True, eq=False):
    """The front of one vehicle."""

    name: str
    about: str
    """text beside the name"""
    points: Sequence[FrontPoint]
    """shortest first; at least one"""
    exposure: NDArray[np.float64]
    """P_s (rows, cols); infinite in walls"""
    start: LatLon
    goal_cells: Sequence[Cell]
    entry_s: float
    """time from take-off to the entry cell, where the route length begins [s]"""
    speed_m_s: float
    chosen: tuple[float, float]
    """(length [m], ΣP_s) of the configured route"""
    chosen_label: str
    """the planner's name, or `w = …`"""
    bounds: Sequence[FrontBound]
    chosen_track: Sequence[LatLon] | None = None
    """the configured route's line on the map; None if this route is in `points`"""
