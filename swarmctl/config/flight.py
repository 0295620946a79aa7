"""The section `flight` of a configuration."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from swarmctl.core.any_angle.corners import ExposureMeasure
from swarmctl.core.section import Section


class FlightSection(Section):
    """Altitudes, tracks and timeouts of the flight, and its end on Ctrl-C."""

    altitude_m: float = Field(
        40.0, gt=2.0, le=1000.0, description="Flight altitude of the first vehicle above home [m]."
    )
    altitude_step_m: float = Field(
        5.0, ge=0.0, description="Altitude difference of each vehicle from the previous one [m]."
    )
    any_angle: bool = Field(
        False,
        description="Straighten routes if length and exposure do not grow. false: vehicles fly the paper's "
        "lattice routes.",
    )
    any_angle_exposure: ExposureMeasure = Field(
        ExposureMeasure.ENTERED,
        description="Exposure that any_angle does not increase: entered (ΣP_s over the cells entered, and "
        "P_s along the track) or integral (P_s along the track alone). integral straightens more, but enters "
        "more cells, so ΣP_s may rise and the survival probability may fall.",
        strict=False,
    )
    on_exit: Literal["hold", "return", "land"] = Field(
        "return", description="Action of all vehicles on Ctrl-C, after a hold."
    )
    on_exit_deadline_s: float = Field(
        300.0, gt=0.0, description="Longest wall time of the on_exit action, until the last landing [s]."
    )
    connect_timeout_s: float = Field(
        15.0, gt=0.0, description="Longest wait for a vehicle's first heartbeat [s]."
    )
    ready_timeout_s: float = Field(
        120.0, gt=0.0, description="Longest wait for a vehicle that is not ready to arm [s]."
    )
    lost_timeout_s: float = Field(
        60.0, gt=0.0, description="Silence of a vehicle after which the run continues without it [s]."
    )
    max_start_distance_m: float = Field(
        5000.0, gt=0.0, description="Greatest distance of a start from its entry cell [m]."
    )
