"""The map as a NiceGUI element; `static/risk_map.js` and its modules draw it."""

from __future__ import annotations

import base64
from typing import Any

import msgspec
import numpy as np
from nicegui import ui
from numpy.typing import NDArray

from swarmctl.dashboard.picture import AreaPicture


class RiskMap(ui.element, component="static/risk_map.js", esm={"risk-map": "static/risk_map"}):
    """The map of one browser."""

    def set_area(self, area: AreaPicture) -> None:
        self.run_method("set_area", msgspec.to_builtins(area))

    def apply(self, changes: dict[str, Any]) -> None:
        """Send what `changes.changes` found."""
        self.run_method("apply", changes)

    def set_options(self, **options: Any) -> None:
        self.run_method("set_options", options)

    def set_exposure(self, exposure: NDArray[np.float64], largest: float) -> None:
        """Send P_s of every cell, (rows, cols), as a byte a cell: 255 is `largest`."""
        share = exposure / largest if largest > 0.0 else exposure
        codes = base64.b64encode(np.round(255.0 * share).astype(np.uint8).tobytes()).decode()
        self.run_method("set_exposure", codes, largest)
