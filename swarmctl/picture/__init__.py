"""Pictures as PNG: the map of a run, shaded as in the paper's Figure 8, and the fronts of routes."""

from __future__ import annotations

from swarmctl.picture.front import FrontBound, FrontPanel, FrontPoint, draw_fronts
from swarmctl.picture.scene import MapPicture, PlannedTrack, VehicleTrack
from swarmctl.picture.sheet import draw_map, figure_of

__all__ = [
    "FrontBound",
    "FrontPanel",
    "FrontPoint",
    "MapPicture",
    "PlannedTrack",
    "VehicleTrack",
    "draw_fronts",
    "draw_map",
    "figure_of",
]
