"""The map of a run as a PNG: the area shaded as in the paper's Figure 8, what was known, and every track."""

from __future__ import annotations

from swarmctl.picture.scene import MapPicture, PlannedTrack, VehicleTrack
from swarmctl.picture.sheet import draw_map, figure_of

__all__ = ["MapPicture", "PlannedTrack", "VehicleTrack", "draw_map", "figure_of"]
