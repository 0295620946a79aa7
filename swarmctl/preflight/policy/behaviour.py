"""The declared behaviour of one vehicle, for every firmware. Pure."""

from __future__ import annotations

import math

import msgspec

from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.agent.traffic.return_schedule import CLIMBS_TO_M
from swarmctl.config.preflight import Policy
from swarmctl.preflight.policy.required import NoParameterTable, RequiredParameter


class DeclaredBehaviour(msgspec.Struct, frozen=True):
    """The declared behaviour of one vehicle: failsafes, heights, speeds and turns."""

    policy: Policy
    gcs_sysid: int
    """system id of the ground station whose heartbeats the vehicle watches"""
    altitude_m: float
    """flight altitude above home"""
    ceiling_m: float
    """greatest allowed height above home"""
    wings: FixedWing | None = None
    """performance of a fixed wing; None for a copter"""
    speed_m_s: float = 15.0
    """cruise speed: a copter's speed over ground, a fixed wing's airspeed"""
    turn_radius_m: float = 40.0
    """turn radius of a fixed wing"""
    among_others: bool = False
    """True if the swarm has other vehicles"""
    extent_m: float = 0.0
    """greatest distance between two points of the flight [m]"""
    in_formation: bool = False
    """True if the vehicle follows set-points as a member of a formation"""

    def fixed_wing(self) -> FixedWing:
        """Return the performance of a fixed wing. Raises NoParameterTable if a copter is configured."""
        if self.wings is None:
            raise NoParameterTable("a fixed wing, but configured as a copter; set `airframe: plane`")
        return self.wings

    @property
    def lost_link(self) -> str:
        return f"preflight.policy.lost_link: {self.policy.lost_link}"

    @property
    def lost_link_after(self) -> str:
        return f"preflight.policy.lost_link_after_s: {self.policy.lost_link_after_s}"

    @property
    def low_battery(self) -> str:
        return f"preflight.policy.low_battery: {self.policy.low_battery}"

    @property
    def fence_breach(self) -> str:
        return f"preflight.policy.fence_breach: {self.policy.fence_breach}"

    @property
    def max_return_height_m(self) -> float:
        """Greatest height above home to which a return may climb [m]; in a swarm the flight altitude."""
        return min(CLIMBS_TO_M, self.ceiling_m, self.altitude_m if self.among_others else math.inf)

    @property
    def returns(self) -> str:
        return f"a return at {self.max_return_height_m:g} m or below"

    @property
    def fence(self) -> str:
        return f"a fence up to {self.ceiling_m:g} m"


SETPOINTS_STOP = "a formation: a vehicle whose set-points stop stops, returns or lands"


def ceiling(name: str, behaviour: DeclaredBehaviour) -> RequiredParameter:
    """Return the requirement on a ceiling: from the flight altitude up to the declared ceiling."""
    return RequiredParameter(
        name, behaviour.fence, behaviour.ceiling_m, least=behaviour.altitude_m, most=behaviour.ceiling_m
    )


_SPEED_TOLERANCE_M_S = 0.5
_G_M_S2 = 9.81


def cruise_and_bank(
    behaviour: DeclaredBehaviour, airspeed: str, bank_limit: str
) -> tuple[RequiredParameter, RequiredParameter]:
    """Return the requirements on a fixed wing's airspeed [m/s] and bank limit [deg]."""
    speed, radius_m = cruise_speed(airspeed, behaviour), behaviour.turn_radius_m
    bank_deg = math.degrees(math.atan2(behaviour.speed_m_s**2, _G_M_S2 * radius_m))
    turns = f"turn_radius_m: {radius_m:g} at {speed.declared}"
    return speed, RequiredParameter(bank_limit, turns, least=bank_deg, most=90.0)


def cruise_speed(name: str, behaviour: DeclaredBehaviour) -> RequiredParameter:
    """Return the requirement on a cruise speed [m/s]. This program does not write the parameter."""
    speed_m_s = behaviour.speed_m_s
    least, most = speed_m_s - _SPEED_TOLERANCE_M_S, speed_m_s + _SPEED_TOLERANCE_M_S
    return RequiredParameter(name, f"speed_m_s: {speed_m_s:g}", least=least, most=most)
