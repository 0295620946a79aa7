"""The section `wings` of a configuration: performance of fixed wings."""

from __future__ import annotations

from pydantic import Field

from swarmctl.core.section import Section


class WingsSection(Section):
    """Performance of all fixed wings. A vehicle's own `speed_m_s` and `turn_radius_m` have precedence."""

    speed_m_s: float = Field(
        15.0, gt=5.0, le=35.0, description="Default cruise airspeed of fixed wings [m/s]."
    )
    min_speed_m_s: float = Field(
        11.0,
        gt=3.0,
        le=35.0,
        description="Lowest commanded airspeed of a fixed wing that slows down for `arrival` [m/s].",
    )
    turn_radius_m: float = Field(40.0, gt=0.0, le=1000.0, description="Radius of turns on the route [m].")
    loiter_radius_m: float = Field(
        60.0,
        gt=0.0,
        le=1000.0,
        description="Greatest radius of the circles in which fixed wings hold and descend [m].",
    )
    takeoff_height_m: float = Field(
        20.0,
        gt=5.0,
        le=200.0,
        description="Height above home up to which fixed wings climb straight ahead after take-off [m].",
    )
    final_height_m: float = Field(
        20.0,
        gt=5.0,
        le=200.0,
        description="Height above home at which the straight final approach begins [m].",
    )
    glide_deg: float = Field(6.0, ge=2.0, le=12.0, description="Slope of the final approach [deg].")
    landing_heading_deg: float | None = Field(
        None,
        ge=0.0,
        lt=360.0,
        description="Heading of all landings, clockwise from north [deg], such as into the wind. Default: "
        "for each landing, the heading with the fewest cells of the area under its path; of equal headings, "
        "the heading closest to the direction from start to goal (at home: from start to entry).",
    )

    def model_post_init(self, _context: object) -> None:
        if self.min_speed_m_s > self.speed_m_s:
            raise ValueError(
                f"min_speed_m_s {self.min_speed_m_s:g} is more than speed_m_s {self.speed_m_s:g}; "
                "lower min_speed_m_s"
            )
        if self.loiter_radius_m < self.turn_radius_m:
            raise ValueError(
                f"loiter_radius_m {self.loiter_radius_m:g} is less than turn_radius_m "
                f"{self.turn_radius_m:g}, the tightest turn; raise loiter_radius_m"
            )
