"""The interface of an approach: a member's knowledge of its group, and its set-point."""

from __future__ import annotations

from typing import Any, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.formation.reference import Reference, SpeedProfile
from swarmctl.agent.formation.shape import ShapePlace
from swarmctl.agent.formation.ways import MemberWay
from swarmctl.agent.traffic.separation.approach import Limits

Vector = tuple[float, float, float]
"""east, north, up in the area's local frame [m] or [m/s]"""
ACCELERATION_M_S2, CLIMB_M_S = 2.0, 1.0
"""Greatest acceleration over ground, and greatest climb or sink rate, demanded of a member."""


class Nearby(msgspec.Struct, frozen=True):
    """The position of another vehicle, as it was last told. A set-point builds one for each member."""

    position_m: Vector
    velocity_m_s: Vector
    age_s: float = 0.0
    """time since this was true [s]"""


class OtherMember(Nearby, frozen=True):
    """The last message of another present member."""

    place: ShapePlace = (0.0, 0.0, 0.0)
    """its present place in the shape"""
    error_m: float = 0.0
    """its distance from its place over ground, as it told [m]"""
    way: MemberWay | None = None
    """its own way while the group is split"""


class Along(msgspec.Struct, frozen=True):
    """The reference point along the route, as the leader told it."""

    s_m: float
    """distance along the route [m]"""
    speed_m_s: float
    """speed along the route [m/s]"""
    age_s: float = 0.0
    """time since this was true [s]"""


class ThreatField(msgspec.Struct, frozen=True, eq=False):
    """The exposure P_s of the area, as this member knows it."""

    exposure: NDArray[np.float64]
    """P_s, (rows, cols), row 0 in the south; infinite in walls"""
    cell_m: float
    """size of a cell; the south-west corner of the area is the origin of the local frame [m]"""


class PlaceMemory(msgspec.Struct, frozen=True):
    """The facts that a law keeps from call to call. A member that joins, or has paused, begins with none."""

    now_s: float
    """time of the call, by the member's clock [s]"""
    place_m: Vector
    """position of the place"""
    velocity_m_s: Vector
    """velocity of the place"""
    demanded_m: Vector
    """position demanded of the member, which does not jump with the place"""
    demanded_m_s: Vector
    """velocity demanded of the member"""
    along: Along
    """the reference point"""


class Group(msgspec.Struct, frozen=True):
    """A group as one of its members sees it now."""

    now_s: float
    position_m: Vector
    """own position"""
    velocity_m_s: Vector
    """own velocity"""
    place: ShapePlace
    """own place, after the choice of shape and the assignment of places"""
    others: tuple[OtherMember, ...]
    """the other present members; in leader following the leader is `others[leader]`"""
    along: Along | None
    """the reference point told last, by the leader or by this member if it leads; None: none yet"""
    reference: Reference
    profile: SpeedProfile
    height_m: float
    """height of the reference point, in the datum of `position_m` [m]"""
    speed_m_s: float
    """greatest speed over ground that is demanded of a member"""
    limits: Limits
    """separation of two members"""
    obstacles: tuple[Nearby, ...] = ()
    """members that leave, and the places at which silent members may have stopped"""
    leader: int | None = None
    """index of the leader in `others`; None: this member leads"""
    flies_mission: bool = False
    """True: this vehicle leads by its mission, without set-points"""
    memory: PlaceMemory | None = None
    threats: ThreatField | None = None
    way: MemberWay | None = None
    """own way while the group is split"""
    lead_s: float = 0.0
    """Time by which a demand is made for later [s]: half the period of the set-points for a vehicle whose
    target rests between them, such as PX4."""

    @property
    def is_leader(self) -> bool:
        """True if this member leads."""
        return self.leader is None


class SetPointDemand(msgspec.Struct, frozen=True):
    """The velocity that a member shall fly, with the position that moves at this velocity.

    Without a position the velocity alone counts.
    """

    velocity_m_s: Vector
    position_m: Vector | None = None


class ApproachResult(msgspec.Struct, frozen=True):
    """The answer of an approach."""

    demand: SetPointDemand | None
    """None: the member flies its mission"""
    error_m: Vector
    """the member's position minus its place: forward, right, up [m]"""
    memory: PlaceMemory
    """the facts for the next call, with the reference point, which the leader tells"""
    mission_speed_m_s: float | None = None
    """speed for the mission of a leader that flies it; None: the member flies set-points"""


class Approach(Protocol):
    """The interface of a module in `APPROACHES`."""

    @property
    def LEADER_FLIES_MISSION(self) -> bool:  # noqa: N802
        """True if the leader flies its mission, as long as it need not stop for a new one."""

    @property
    def MEMBERS_TELL_HZ(self) -> float:  # noqa: N802
        """Rate at which a member that does not lead tells its position [Hz]."""

    @property
    def WEIGHTS(self) -> tuple[str, ...]:  # noqa: N802
        """Names of the behaviours whose weights (`NAME_weight` in Params) may change in flight."""

    @property
    def Params(self) -> Any:  # noqa: N802 - it is a class, found in a module
        """A frozen section with a default for each field."""

    def fly(self, params: Any, group: Group, /) -> ApproachResult:
        """Return the member's set-point, or the speed of a leader's mission."""
