"""The predicted flight of a member of a group: to its place, and with it along the group's route. Pure."""

from __future__ import annotations

import math

from swarmctl.agent.formation.near_members import places_of
from swarmctl.agent.formation.ways import offset_of
from swarmctl.agent.replan.climb import CLIMB_M_S, DESCENT_M_S
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.prediction import home_amsl_m
from swarmctl.agent.traffic.separation.trajectory import LocalPoint, Trajectory
from swarmctl.core.planar import by_heading

EVERY_S = 2.0
"""Time between two points of the flight [s]."""
MAX_POINTS = 100
"""Greatest number of computed points: the flight is announced for 200 s at most."""
NEAR_M = 0.3
"""Distance on each axis within which the flight may pass a computed point [m]; such a point is left out."""


def flight_in_group(state: AgentState, here: LocalPoint, for_s: float = math.inf) -> Trajectory | None:
    """Return the flight from 0 s on, with heights above home; None before the first set-point.

    The vehicle keeps its present velocity for EVERY_S, because others may be between it and its place. Then
    its distance from the place shrinks to 0 at its spare speed.
    The vehicle climbs or descends to the place's present height at once.
    `for_s`: time for which the flight is needed at least [s].
    """
    formation, membership = state.task.formation, state.membership
    route, along, memory = membership.route, membership.along, membership.memory
    if formation is None or route is None or along is None or memory is None:
        return None
    pose = route.reference.at(along.s_m)
    if (way := route.way_of(state.task.uav)) is None:
        away_e, away_n = memory.place_m[0] - pose.east_m, memory.place_m[1] - pose.north_m
        place = (*by_heading((away_e, away_n), pose.heading_rad), 0.0)
    else:
        place = places_of(state, formation)[state.task.uav]
    velocity_m_s = state.vehicle.east_m_s, state.vehicle.north_m_s
    moves_e, moves_n = (EVERY_S * (velocity_m_s[k] - memory.velocity_m_s[k]) for k in (0, 1))
    off_e, off_n = here[0] - memory.place_m[0] + moves_e, here[1] - memory.place_m[1] + moves_n
    spare_m_s = max(state.task.speed_m_s - formation.speed_m_s, 1.0)
    joins_in_s = math.hypot(off_e, off_n) / spare_m_s
    rises_m = memory.place_m[2] - home_amsl_m(state) - here[2]
    s_m, speed_m_s = along.s_m, along.speed_m_s
    times, points = [0.0], [here]
    while (
        len(points) < MAX_POINTS and times[-1] < for_s and s_m < route.reference.length_m and speed_m_s > 0.0
    ):
        s_m, speed_m_s = route.profile.ahead(s_m, speed_m_s, EVERY_S)
        t_s = times[-1] + EVERY_S
        ahead = route.reference.at(s_m)
        (to_e, to_n), _ = offset_of(ahead, place, way)
        east_m, north_m = ahead.east_m + to_e, ahead.north_m + to_n
        left = max(1.0 - times[-1] / joins_in_s, 0.0) if joins_in_s else 0.0
        times.append(t_s)
        up_m = here[2] + min(max(rises_m, -DESCENT_M_S * t_s), CLIMB_M_S * t_s)
        points.append((east_m + left * off_e, north_m + left * off_n, up_m))
    return Trajectory(tuple(times), tuple(points)).checked().thinned(NEAR_M) if len(points) > 1 else None
