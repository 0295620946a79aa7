"""An agent whose vehicle another vehicle approaches."""

from __future__ import annotations

from typing import Any

from agent_stories import GRID, MID_M, Story, orders

from swarmctl.agent.traffic.separation.watch import AvoidanceAction, SeparationRules
from swarmctl.core import events as ev
from swarmctl.core.frames import StateShared
from swarmctl.core.records import replace


class ApproachStory(Story):
    """Vehicle 2 flies east along row 4 at 10 m/s; `other` delivers a state of vehicle 1 or 3."""

    def __init__(self, action: AvoidanceAction = "hold", **changes: Any) -> None:
        super().__init__(uav=2, separation=replace(SeparationRules(), action=action), **changes)
        self.flying()
        self.at(100.0)

    def other(
        self, uav: int, east_m: float, north_m: float, velocity: tuple[float, float, float], **changes: Any
    ) -> None:
        lat_deg, lon_deg = GRID.frame.to_geodetic(east_m, north_m)
        shared = {"time_s": 1.0, "lat_deg": lat_deg, "lon_deg": lon_deg, "alt_rel_m": 30.0, "phase": "flying"}
        shared |= {"n_observed": 0, "n_found": 0, "velocity_m_s": velocity, "hears": (self.state.task.uav,)}
        shared |= {"age_s": 1.0, **changes}
        shared.setdefault("alt_amsl_m", 300.0 + shared["alt_rel_m"])
        # It is of the time of the last telemetry, and comes with the next one.
        self.tell(neighbours=((uav, StateShared(**shared)),))

    def crossing(self, uav: int, away_m: float = 100.0, **changes: Any) -> None:
        """Send the state of a vehicle on its way north over the middle of the area.

        It will be `away_m` before the middle when vehicle 2 gets its next telemetry.
        """
        self.other(uav, MID_M[0], MID_M[1] - away_m - 10.0, (0.0, 10.0, 0.0), **changes)

    def stopped(self, uav: int = 1, **changes: Any) -> None:
        """Let vehicle 2 stop 50 m before the middle, for a vehicle that crosses its way there."""
        self.crossing(uav, 50.0, **changes)
        assert orders(self.at(MID_M[0] - 50.0)) == [ev.FlightOrder.HOLD]
        self(ev.OrderDone(ev.FlightOrder.HOLD))
