"""A group of agents with light vehicles in calm air."""

from __future__ import annotations

import math
import random
from itertools import combinations
from typing import Any

from group_flights import group
from light_swarm import TELEMETRY_EVERY, Air, LightAgent, LightSwarm
from light_vehicle import LightVehicle

from swarmctl.agent.phases import Phase
from swarmctl.core.records import replace
from swarmctl.core.vehicle import VehicleState


class LateVehicle(LightVehicle):
    """A vehicle whose telemetry is as old as its link's delay."""

    delay_s = 0.0

    def telemetry(self, boot_s: float) -> VehicleState:
        now = super().telemetry(boot_s)
        if not self.delay_s or now.lat_deg is None or now.lon_deg is None:
            return now
        east_m, north_m = self.frame.to_local(now.lat_deg, now.lon_deg)
        then = self.frame.to_geodetic(
            east_m - self.delay_s * now.east_m_s, north_m - self.delay_s * now.north_m_s
        )
        return replace(
            now, time_boot_s=boot_s - self.delay_s, delay_s=self.delay_s, lat_deg=then[0], lon_deg=then[1]
        )


class LightGroup(LightSwarm):
    """Three members; the first one leads."""

    def __init__(
        self, *, like_ardupilot: bool = True, approach: str = "leader_following", **changes: Any
    ) -> None:
        super().__init__(group(approach, **changes), random.Random(1), Air())
        for i in range(len(self.scenario.tasks)):
            self.add(like_ardupilot=like_ardupilot, rng=random.Random(i), kind=LateVehicle)
        self.launch()

    def joined(self) -> LightGroup:
        """Fly until both followers have been at their places for a while."""
        self.run_while(lambda: not all(self.is_in_place(agent) for agent in self.agents[1:]), 90.0)
        return self

    def run_while(self, condition: Any, for_s: float) -> None:
        """Fly while a condition holds. Raises AssertionError if it still holds after `for_s`."""
        until_s = self.now + for_s
        while condition():
            assert self.now < until_s, [agent.said[-3:] for agent in self.agents]
            self.run(self.now + TELEMETRY_EVERY * self.step_s, lambda _now: None)

    @staticmethod
    def is_in_place(agent: LightAgent) -> bool:
        error_m = agent.state.membership.error_m
        return agent.state.phase is Phase.FORMATION and error_m is not None and max(map(abs, error_m)) < 3.0

    def from_place_m(self, uav: int) -> float:
        """Return the true distance of a follower from its place, while the leader flies to the east."""
        leader, member = self.agents[0].vehicle, self.agents[uav - 1]
        formation = member.task.formation
        assert formation is not None
        forward_m, right_m, _ = formation.places(0, len(self.agents))[uav - 1]
        east_m, north_m = leader.at[0] + forward_m, leader.at[1] - right_m
        return math.hypot(member.vehicle.at[0] - east_m, member.vehicle.at[1] - north_m)

    def share_of_limits(self, *agents: LightAgent) -> float:
        """Return the least true separation of two of the vehicles, as a share of the limits."""
        limits = self.scenario.config.separation
        pairs = combinations([agent.vehicle.at for agent in agents], 2)
        return min(
            max(math.dist(a[:2], b[:2]) / limits.horizontal_m, abs(a[2] - b[2]) / limits.vertical_m)
            for a, b in pairs
        )
