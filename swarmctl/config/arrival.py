"""When the vehicles arrive, seen together: the section `arrival` of a configuration."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from swarmctl.core.section import Section


class ArrivalSection(Section):
    """All are over their goals together, or one after the other; the slowest sets the time."""

    mode: Literal["simultaneous", "staggered"] = Field(
        description="simultaneous: all at one time; staggered: by their system ids, spacing_s apart"
    )
    spacing_s: float | None = Field(
        None, gt=0.0, le=600.0, description="from one arrival to the next, with staggered [s]"
    )
    tolerance_s: float = Field(3.0, gt=0.0, description="how far off the agreed time an arrival may be [s]")

    slowest_m_s: float = Field(
        0.0, ge=0.0, description="no vehicle is slowed down below this, a fifth of its speed, or 1 m/s [m/s]"
    )

    def model_post_init(self, _context: object) -> None:
        if self.mode == "staggered" and self.spacing_s is None:
            raise ValueError("staggered arrivals need spacing_s, the seconds from one to the next")
        if self.mode == "simultaneous" and self.spacing_s is not None:
            raise ValueError("spacing_s is for mode staggered; give that, or leave it away")
