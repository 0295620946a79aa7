"""Configurations with fixed wings."""

from __future__ import annotations

import json
from typing import Any

from swarmctl.config.model import Config

AREA = {"origin_lat_deg": 46.0, "origin_lon_deg": 14.4, "rows": 12, "cols": 12, "cell_size_m": 50.0}


def winged(**sections: Any) -> Config:
    """Return a configuration of a fixed wing and a copter over 12 × 12 cells, changed by `sections`."""
    content: dict[str, Any] = {
        "area": AREA,
        "threats": {"count": 5},
        "flight": {"any_angle": True},
        "simulate": {"count": 2, "autopilot": ["arduplane", "ardupilot"], "start_distance_m": 150.0},
    }
    content |= {key: content.get(key, {}) | value for key, value in sections.items()}
    return Config.model_validate_json(json.dumps(content))
