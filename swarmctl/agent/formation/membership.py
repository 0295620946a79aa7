"""The group as one vehicle knows it: its fixed task, the newest message of each member, and its route. Pure.

All members apply the same rule to the same messages: the first present member in the group's order leads. So
all follow the same leader within the time after which a silent member counts as absent.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any, Literal

import msgspec

from swarmctl.agent.formation.approaches.base import ACCELERATION_M_S2, Along, Approach, PlaceMemory
from swarmctl.agent.formation.reference import Reference, SpeedProfile, window_for
from swarmctl.agent.formation.shape import Shape, ShapePlace, radius_m
from swarmctl.agent.formation.ways import MemberWay, SplitStretch
from swarmctl.core.frames import MAX_POINTS, MemberShared
from swarmctl.core.geo import LocalFrame
from swarmctl.core.planar import PlanarPoint, turning_points
from swarmctl.core.records import replace

PLACE_KEPT = 3.0
"""Silence for which a member keeps its place, as a multiple of the silence after which another one leads: a
gap in the messages must not move the whole group."""
SETTLING_S = 4.0
"""Time of a change of shape besides the members' ways at their closing speed [s]."""
IN_PLACE_M = 5.0
"""Distance from its place within which a member is in place [m]."""
NEARER_M = 1.0
"""Least distance by which a member that follows comes nearer to its place in `Formation.max_error_s` [m]."""


class Formation(msgspec.Struct, frozen=True, dict=True):
    """The configured group of a vehicle."""

    name: str
    members: tuple[int, ...]
    """system ids in the order in which they take places, and lead"""
    approach: Approach
    params: Any
    shapes: tuple[Shape, ...]
    """the shape, and a second one for narrow passages if there is one"""
    speed_m_s: float
    """speed of the reference point"""
    exposure: Literal["sum", "survival"] = "sum"
    """exposure of the group in its planner"""
    closes_up: bool = True
    is_level: bool = False
    """True: all members fly at the leader's height; False: each at its own"""
    lost_after_s: float = 2.0
    """silence after which a member counts as absent, so that another one may lead [s]"""
    alone_after_s: float = 10.0
    """time without any other member after which a member flies its own mission [s]"""
    max_error_m: float = 30.0
    """distance from its place above which a member that comes no nearer leaves the group"""
    max_error_s: float = 15.0
    """time after which it leaves [s]"""
    rate_hz: float = 5.0
    """rate of set-points, and of the leader's messages"""
    cell_m: float = 0.0
    """size of a cell of the area [m]"""
    split_factor: float | None = None
    """price of flying apart (`planners.meeting`); None: the group never splits"""
    reach_m: float = math.inf
    """range of messages [m]"""

    @cached_property
    def _places(self) -> tuple[tuple[tuple[ShapePlace, ...], ...], ...]:
        """Places by shape and number of members, because they are asked for at each set-point."""
        numbers = range(len(self.members) + 1)
        # Too few offsets are a problem of the configuration, which is checked later.
        return tuple(tuple(shape.places(min(n, shape.n_most)) for n in numbers) for shape in self.shapes)

    @cached_property
    def radius_m(self) -> float:
        """Greatest distance of a place from the reference point, over all shapes [m]."""
        return max(radius_m(sizes[-1]) for sizes in self._places)

    def weights_with(self, before: tuple[float, ...], changes: Mapping[str, float]) -> tuple[float, ...]:
        """Return the weights of all behaviours after changes by name; `before`: empty as configured."""
        now = before or (getattr(self.params, f"{name}_weight") for name in self.approach.WEIGHTS)
        return tuple(
            changes.get(name, weight) for name, weight in zip(self.approach.WEIGHTS, now, strict=True)
        )

    def params_with(self, weights: tuple[float, ...]) -> Any:
        """Return the parameters of the approach with these weights; empty: as configured."""
        if not weights:
            return self.params
        names = (f"{name}_weight" for name in self.approach.WEIGHTS)
        return self.params.model_copy(update=dict(zip(names, weights, strict=True)))

    def shape(self, number: int) -> Shape:
        """Return the shape of a number; of a greater number than there are shapes, the last one."""
        return self.shapes[min(number, len(self.shapes) - 1)]

    def places(self, number: int, n_present: int) -> tuple[ShapePlace, ...]:
        """Return the places of shape `number`."""
        n = n_present if self.closes_up else len(self.members)
        return self._places[min(number, len(self.shapes) - 1)][n]

    def change_m(self, n_present: int) -> float:
        """Return the length of the route on which the members take their places in another shape [m]."""
        first, last = self.places(0, n_present), self.places(len(self.shapes) - 1, n_present)
        farthest_m = max((math.dist(a, b) for a, b in zip(first, last, strict=True)), default=0.0)
        change_s = farthest_m / self.params.closing_m_s + SETTLING_S if len(self.shapes) > 1 else 0.0
        return self.speed_m_s * change_s

    @property
    def ends_before_m(self) -> float:
        """Distance before the end of the route at which the group stops, and its members go on alone [m]."""
        return self.radius_m + self.cell_m

    @property
    def keeps_place_s(self) -> float:
        """Silence for which the place of a member stays its own [s]."""
        return PLACE_KEPT * self.lost_after_s


class MemberReport(msgspec.Struct, frozen=True):
    """The newest message of a member."""

    message: MemberShared
    at_boot_s: float
    """time of its position, by this vehicle's clock [s]"""
    here_m: PlanarPoint
    """its position, (east, north) in the area's local frame [m]"""


class FarFromPlace(msgspec.Struct, frozen=True):
    """A member that is farther from its place than it should be."""

    least_m: float
    """least distance from the place since then [m]"""
    since_boot_s: float
    """time at which the member last came nearer"""


def far_from_place(
    before: FarFromPlace | None, away_m: float, now_s: float, formation: Formation
) -> FarFromPlace | None:
    """Return the record of a member `away_m` from its place; None if it is near enough.

    A member that joins, or that takes another place, is far away for a while, but it comes nearer.
    """
    if away_m <= formation.max_error_m:
        return None
    if before is None or away_m <= before.least_m - NEARER_M:
        return FarFromPlace(away_m, now_s)
    return before


class GroupRoute(msgspec.Struct, frozen=True, eq=False):
    """The route of a group's reference point, as its leader tells it."""

    leader: int
    number: int
    shapes: tuple[tuple[float, int], ...]
    """(distance along the route [m], number of the shape from there on)"""
    reference: Reference
    profile: SpeedProfile
    plan: tuple[int, int] | None = None
    """the leader's alone: number of its mission's plan, and of the members for which it chose shapes"""
    split: SplitStretch | None = None

    @classmethod
    def of(
        cls,
        leader: int,
        number: int,
        points_m: tuple[PlanarPoint, ...],
        shapes: tuple[tuple[float, int], ...],
        formation: Formation,
        max_speed_m_s: float,
        plan: tuple[int, int] | None = None,
        split: SplitStretch | None = None,
    ) -> GroupRoute:
        """Return a route; `max_speed_m_s`: greatest speed of a member.

        Only its corners count, because a message holds MAX_POINTS of them. A longer route ends earlier.
        """
        extent_m = formation.radius_m
        reference = Reference.over(tuple(turning_points(points_m)[:MAX_POINTS]), window_for(extent_m))
        end_m = max(reference.length_m - formation.ends_before_m, 0.0)
        ways = () if split is None else [(split.begin_m, split.end_m, c) for c in split.curves.values()]
        profile = SpeedProfile.of(
            reference, extent_m, formation.speed_m_s, max_speed_m_s, ACCELERATION_M_S2, end_m, ways
        )
        return cls(leader, number, shapes, reference, profile, plan, split)

    def is_of(self, leader: int, number: int) -> bool:
        return (self.leader, self.number) == (leader, number)

    def shape_at(self, along_m: float) -> int:
        """Return the number of the shape at a distance along the route."""
        return next((number for from_m, number in reversed(self.shapes) if along_m >= from_m), 0)

    def split_at(self, along_m: float) -> SplitStretch | None:
        """Return the split of the group at a distance along the route; None: it flies together."""
        return self.split if self.split is not None and self.split.is_at(along_m) else None

    def way_of(self, uav: int) -> MemberWay | None:
        """Return the member's own way in the split; the leader of the plan has none, it flies the route."""
        return None if self.split is None else self.split.way_of(uav)


class Membership(msgspec.Struct, frozen=True):
    """The group as one vehicle knows it; times are by this vehicle's clock."""

    told: Mapping[int, MemberReport] = msgspec.field(default_factory=dict)
    route: GroupRoute | None = None
    """the route that the vehicle follows, or tells while it leads"""
    present: tuple[int, ...] = ()
    """the present members, this vehicle included, in the group's order; empty: the vehicle is in no group"""
    with_places: tuple[int, ...] = ()
    """the members that have places, by the last message in the group: the present ones, and those that are
    silent for a short time"""
    n_routes: int = 0
    """number of routes that this vehicle has told as the leader"""
    n_present_since_boot_s: float = -math.inf
    memory: PlaceMemory | None = None
    """the last call of the approach; None: before the first, and away from the group"""
    shape: int = 0
    """number of the present shape"""
    has_shape: bool = False
    """True: since this vehicle joined, a member that follows has been at its place"""
    is_split: bool = False
    """True: the members fly ways of their own"""
    error_m: ShapePlace | None = None
    """the vehicle's position minus its place: forward, right, up [m]; None: it flies to no place"""
    far: FarFromPlace | None = None
    """record of a vehicle far from its place; None: it is near"""
    weights: tuple[float, ...] = ()
    """weights of the approach's behaviours after an operator's change, in its order; empty: as configured"""
    setpoint_role: str = ""
    """role of the mode in which the vehicle follows set-points; empty: not confirmed yet"""
    stands_since_boot_s: float | None = None
    """time since which the vehicle has stood still by set-points before it leaves; None: it does not"""
    left_boot_s: float = -math.inf
    is_over: bool = False
    """True: the group has ended for this vehicle"""
    sent_boot_s: float = -math.inf
    """time of the last message; −∞: a message with the route is due at once"""
    joins_told: bool = False
    """last value of `MemberShared.joins` that was sent"""
    in_group_boot_s: float = -math.inf
    """time of the last message from within the group"""
    hidden: frozenset[int] = frozenset()
    """members hidden from the rules for other traffic, because they keep apart by set-points"""

    @property
    def leader(self) -> int | None:
        """The first present member; None: the vehicle is in no group."""
        return self.present[0] if self.present else None

    @property
    def n_present(self) -> int:
        """Number of present members; a vehicle in no group is alone."""
        return max(len(self.present), 1)

    @property
    def along(self) -> Along | None:
        """The reference point as this vehicle last computed it; its age counts from `memory.now_s`."""
        return None if self.memory is None else self.memory.along

    @property
    def stands_still(self) -> bool:
        return self.stands_since_boot_s is not None

    @property
    def from_place_m(self) -> float:
        """Distance from the place over ground [m]; 0 if the vehicle flies to no place."""
        return 0.0 if self.error_m is None else math.hypot(*self.error_m[:2])

    def with_messages(
        self, told: Iterable[tuple[int, float, MemberShared]], now_s: float, frame: LocalFrame
    ) -> Membership:
        """Return the membership with new messages: (UAV, age of the message at `now_s`, message).

        frame: the area's local frame
        """
        new = {
            uav: MemberReport(
                message,
                now_s - age_s - message.age_s,
                frame.to_local(message.lat_deg, message.lon_deg),
            )
            for uav, age_s, message in told
        }
        return replace(self, told={**self.told, **new})

    def without_place(self, now_s: float) -> Membership:
        """Return the membership of a vehicle that leaves its place at `now_s`."""
        return replace(
            self,
            memory=None,
            shape=0,
            has_shape=False,
            is_split=False,
            error_m=None,
            far=None,
            setpoint_role="",
            stands_since_boot_s=None,
            left_boot_s=now_s,
        )
