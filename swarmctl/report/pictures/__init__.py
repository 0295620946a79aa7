"""Pictures as PNG: the map of a run, shaded as in the paper's Figure 8, and Pareto fronts of routes."""

from __future__ import annotations

from swarmctl.report.pictures.front import FrontBound, FrontPanel, FrontPoint, draw_fronts
from swarmctl.report.pictures.scene import MapPicture, PlannedTrack, VehicleTrack
from swarmctl.report.pictures.sheet import draw_map, figure_of

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
