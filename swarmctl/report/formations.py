"""Statistics of groups: errors of the members, time in shape, changes of leader and shape, and splits."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from swarmctl.agent.formation.membership import IN_PLACE_M
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import AgentState
from swarmctl.config.model import Config
from swarmctl.core.geo import LatLon
from swarmctl.report.pictures.scene import GROUP_EVERY_S

LONGEST_STEP_S = 2.0
"""Longest time between two telemetry messages that counts as time in a group [s]."""
AXES = ("along", "across", "height")


@dataclass(slots=True)
class MemberStatistics:
    """The flight of one member at its place.

    Errors count from its arrival there on, and after a change of shape or of members from its next arrival.
    """

    is_joined: bool = False
    n: int = 0
    squares_m2: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    largest_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    in_group_s: float = 0.0
    in_place_s: float = 0.0
    leader_changes: int = 0
    shape_changes: int = 0
    splits: int = 0
    joins: int = 0

    def summary(self) -> dict[str, Any]:
        rms_m = [math.sqrt(square / self.n) if self.n else None for square in self.squares_m2]
        return {
            "rms_error_m": dict(zip(AXES, rms_m, strict=True)),
            "largest_error_m": dict(zip(AXES, self.largest_m if self.n else [None] * 3, strict=True)),
            "time_in_group_s": self.in_group_s,
            "time_in_place_s": self.in_place_s,
            "joins": self.joins,
            "leader_changes": self.leader_changes,
            "shape_changes": self.shape_changes,
            "splits": self.splits,
        }


@dataclass(slots=True)
class GroupStatistics:
    """The flight of one group."""

    members: dict[int, MemberStatistics] = field(default_factory=dict)
    led_s: defaultdict[int, float] = field(default_factory=lambda: defaultdict(float))
    """time for which each member has led [s]"""
    shapes_s: defaultdict[int, float] = field(default_factory=lambda: defaultdict(float))
    """time in each shape, by its number [s]"""
    here: dict[int, LatLon] = field(default_factory=dict)
    """last position of each member that flies with the group"""
    drawn_boot_s: float = -math.inf
    """time of the last shape in `FormationStatistics.drawn`, by the leader's clock"""


class FormationStatistics:
    """The groups of a flight."""

    def __init__(self) -> None:
        self._groups: dict[str, GroupStatistics] = {}
        self.drawn: list[Sequence[LatLon]] = []
        """positions of the members of a group at one time, for the map"""

    def moved(self, before: AgentState, after: AgentState) -> None:
        """Count a telemetry message of a vehicle."""
        formation, membership = after.task.formation, after.membership
        if formation is None:
            return
        group = self._groups.setdefault(formation.name, GroupStatistics())
        member = group.members.setdefault(after.task.uav, MemberStatistics())
        flies_with_group = after.phase is Phase.FORMATION or after.leads_group
        self._place(group, after, flies_with_group=flies_with_group)
        if membership.leader is None or membership.n_present == 1:
            return
        step_s = after.vehicle.time_boot_s - before.vehicle.time_boot_s
        if not 0.0 <= step_s <= LONGEST_STEP_S:
            return
        member.in_group_s += step_s
        if after.leads_group:
            group.led_s[after.task.uav] += step_s
            group.shapes_s[membership.shape] += step_s
        earlier = before.membership
        if (earlier.shape, earlier.n_present) != (membership.shape, membership.n_present):
            member.is_joined = False
        if flies_with_group and earlier.leader is not None and earlier.n_present > 1:
            member.leader_changes += earlier.leader != membership.leader
            member.shape_changes += earlier.has_shape and earlier.shape != membership.shape
            member.splits += membership.is_split and not earlier.is_split
        if after.phase is not Phase.FORMATION or (error_m := membership.error_m) is None:
            member.is_joined = False
            return
        if before.phase is not Phase.FORMATION:
            member.joins += 1
        is_in_place = math.hypot(*error_m[:2]) <= IN_PLACE_M
        member.is_joined = member.is_joined or is_in_place
        member.in_place_s += step_s * is_in_place
        if member.is_joined:
            member.n += 1
            for axis, error in enumerate(error_m):
                member.squares_m2[axis] += error * error
                member.largest_m[axis] = max(member.largest_m[axis], abs(error))

    def _place(self, group: GroupStatistics, after: AgentState, *, flies_with_group: bool) -> None:
        """Note the position of a member, and of the whole group every GROUP_EVERY_S."""
        uav, here, now_s = after.task.uav, after.vehicle.lat_lon, after.vehicle.time_boot_s
        if not flies_with_group or here is None or after.membership.n_present == 1:
            group.here.pop(uav, None)
            return
        group.here[uav] = here
        if after.leads_group and len(group.here) > 1 and abs(now_s - group.drawn_boot_s) >= GROUP_EVERY_S:
            group.drawn_boot_s = now_s
            self.drawn.append(tuple(group.here.values()))

    def summary(self, config: Config) -> list[dict[str, Any]]:
        """Return the groups that have flown; `config`: the configuration of their flight."""
        names, sections = config.names, {section.name: section for section in config.formations}
        return [
            {
                "name": name,
                "approach": sections[name].approach,
                "members": {names[uav]: member.summary() for uav, member in sorted(group.members.items())},
                "led_s": {names[uav]: led_s for uav, led_s in group.led_s.items()},
                "time_in_shapes_s": {
                    key: group.shapes_s[number]
                    for number, key in enumerate(("shape", "narrow_shape"))
                    if getattr(sections[name], key) is not None
                },
                "leader_changes": max(member.leader_changes for member in group.members.values()),
                "shape_changes": max(member.shape_changes for member in group.members.values()),
                "splits": max(member.splits for member in group.members.values()),
            }
            for name, group in self._groups.items()
        ]
