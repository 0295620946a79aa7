"""What plans for fixed wings reckon with: the section `wings` of a configuration."""

from __future__ import annotations

from pydantic import Field

from swarmctl.core.section import Section


class WingsSection(Section):
    """All fixed wings of the swarm; a vehicle's own `speed_m_s` and `turn_radius_m` go before."""

    speed_m_s: float = Field(15.0, gt=5.0, le=35.0, description="what simulated ones cruise at [m/s]")
    min_speed_m_s: float = Field(
        11.0, gt=3.0, le=35.0, description="no slower are they told to fly, for arrivals together [m/s]"
    )
    turn_radius_m: float = Field(40.0, gt=0.0, le=1000.0, description="of their turns [m]")
    loiter_radius_m: float = Field(
        60.0,
        gt=0.0,
        le=1000.0,
        description="of the circles in which they hold and lose height, as their own parameters say [m]",
    )
    takeoff_height_m: float = Field(
        20.0, gt=5.0, le=200.0, description="above home, up to which they climb straight on from their start"
    )
    final_height_m: float = Field(
        20.0, gt=5.0, le=200.0, description="above home, from which they come down a straight slope to land"
    )
    glide_deg: float = Field(6.0, ge=2.0, le=12.0, description="of that slope [deg]")
    landing_heading_deg: float | None = Field(
        None,
        ge=0.0,
        lt=360.0,
        description="into which they land, clockwise from north [deg], as into the wind; default: for each "
        "that on which it comes over the fewest cells of the area, and of such the way it flies in any case",
    )

    def model_post_init(self, _context: object) -> None:
        if self.min_speed_m_s > self.speed_m_s:
            raise ValueError(
                f"min_speed_m_s {self.min_speed_m_s:g} is more than speed_m_s {self.speed_m_s:g}; give less"
            )
        if self.loiter_radius_m < self.turn_radius_m:
            raise ValueError(
                f"loiter_radius_m {self.loiter_radius_m:g} is less than turn_radius_m "
                f"{self.turn_radius_m:g}, tighter than which they do not turn; give as much"
            )
