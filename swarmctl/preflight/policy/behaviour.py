"""What the parameters of one vehicle are to say, whichever its firmware. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.agent.traffic.return_turns import CLIMBS_TO_M
from swarmctl.config.preflight import Policy
from swarmctl.preflight.policy.required import RequiredParameter


@dataclass(frozen=True, slots=True)
class DeclaredBehaviour:
    """What the parameters of one vehicle are to say."""

    policy: Policy
    gcs_sysid: int
    """whose heartbeats it is to listen for"""
    altitude_m: float
    """it flies at, above home"""
    ceiling_m: float
    """above home"""
    wings: FixedWing | None = None
    """of what is planned for as a fixed wing"""
    speed_m_s: float = 15.0
    """it cruises so fast; a fixed wing through the air"""
    turn_radius_m: float = 40.0
    """of a fixed wing"""
    among_others: bool = False
    """it is one of a swarm, in which each flies at a height of its own"""

    @property
    def lost_link(self) -> str:
        return f"policy.lost_link: {self.policy.lost_link}"

    @property
    def lost_link_after(self) -> str:
        return f"policy.lost_link_after_s: {self.policy.lost_link_after_s}"

    @property
    def low_battery(self) -> str:
        return f"policy.low_battery: {self.policy.low_battery}"

    @property
    def fence_breach(self) -> str:
        return f"policy.fence_breach: {self.policy.fence_breach}"

    @property
    def returns_at_most_m(self) -> float:
        """Above home, unless it is higher already: turns are reckoned so, no fence is breached by it, and
        vehicles that all return by themselves at once do not climb to one height."""
        return min(CLIMBS_TO_M, self.ceiling_m, self.altitude_m if self.among_others else math.inf)

    @property
    def returns(self) -> str:
        return f"a return at {self.returns_at_most_m:g} m or below"

    @property
    def fence(self) -> str:
        return f"a fence up to {self.ceiling_m:g} m"


def ceiling(name: str, intent: DeclaredBehaviour) -> RequiredParameter:
    """High enough for the flight, and no higher than declared."""
    return RequiredParameter(
        name, intent.fence, intent.ceiling_m, least=intent.altitude_m, most=intent.ceiling_m
    )


_SPEED_OFF_M_S = 0.5
_G_M_S2 = 9.81


def cruise(
    intent: DeclaredBehaviour, airspeed: str, bank_limit: str
) -> tuple[RequiredParameter, RequiredParameter]:
    """By the names of these two: of [m/s] and of [deg]."""
    airspeed_wanted, radius_m = cruises(airspeed, intent), intent.turn_radius_m
    bank_deg = math.degrees(math.atan2(intent.speed_m_s**2, _G_M_S2 * radius_m))
    turns = f"turn_radius_m: {radius_m:g} at {airspeed_wanted.declared}"
    return airspeed_wanted, RequiredParameter(bank_limit, turns, least=bank_deg, most=90.0)


def cruises(name: str, intent: DeclaredBehaviour) -> RequiredParameter:
    """By the name of its speed [m/s], which its owner decides."""
    speed_m_s = intent.speed_m_s
    least, most = speed_m_s - _SPEED_OFF_M_S, speed_m_s + _SPEED_OFF_M_S
    return RequiredParameter(name, f"speed_m_s: {speed_m_s:g}", least=least, most=most)
