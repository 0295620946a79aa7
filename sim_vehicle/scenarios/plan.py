"""Missions and fences of a scenario, with positions in metres from the vehicle's start."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import LocalFrame
from sim_vehicle.scenarios.base import Length, Metres, NoSettings, Number, OneOf, Seconds, Section
from sim_vehicle.station.messages import PlanItem
from sim_vehicle.vehicle.mission import NAVIGATION

Height = Annotated[float, Field(strict=True, gt=0, le=10_000)]
LANDINGS = frozenset(
    {mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_VTOL_LAND, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH}
)
# Items without a position.
WITHOUT_PLACE = frozenset(
    {
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_NAV_DELAY,
        mavlink.MAV_CMD_DO_JUMP,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    }
)
MIN_WIDTH_M = 0.02  # width of the narrowest polygon; MAVLink's unit of 1e-7 degrees is 1.1 cm
MAX_NUMBER = {"MAV_CMD_": 0xFFFF, "MAV_FRAME_": 0xFF}  # largest number of the MAVLink field


def mavlink_number(prefix: str, value: str | int) -> int:
    """Return the MAVLink number of a number or name; raise ValueError if unknown. `prefix`: `MAV_CMD_`, …"""
    if isinstance(value, int):
        if not 0 <= value <= MAX_NUMBER[prefix]:
            raise ValueError(
                f"{prefix}* must be a number from 0 to {MAX_NUMBER[prefix]}, found {value!r:.60}"
            )
        return value
    members = {entry.name: found for found, entry in mavlink.enums[prefix.removesuffix("_")].items()}
    name = value if value.startswith(prefix) else prefix + value
    if name not in members or name == f"{prefix}ENUM_END":
        raise ValueError(
            f"{value!r} is not a name in {prefix}*; use a name of the MAVLink enumeration, or a number"
        )
    return int(members[name])


# A name of MAV_CMD, with or without its prefix, or a number; the value is the number.
Command = Annotated[str | int, AfterValidator(partial(mavlink_number, "MAV_CMD_"))]


class StartOffset(Section):
    """A position [m] east and north of the vehicle's start."""

    east_m: Metres
    north_m: Metres


class Waypoint(StartOffset):
    """A position in the air, with its height above home."""

    height_m: Height
    hold_s: Seconds = 0.0


class Takeoff(Section):
    """A climb; a plane climbs toward the given position. A number alone is the height."""

    height_m: Height
    east_m: Metres = 0.0
    north_m: Metres = 0.0


class Loiter(StartOffset):
    """A circle (plane) or hover (copter) at a position, for a number of turns, a time, or without end."""

    height_m: Height
    turns: Annotated[float, Field(strict=True, gt=0, le=255)] | None = None
    for_s: Seconds | None = None
    radius_m: Number = 0.0  # 0: the vehicle's default; negative: counter-clockwise

    @model_validator(mode="after")
    def _one_end(self) -> Self:
        if self.turns is not None and self.for_s is not None:
            raise ValueError("has both `turns` and `for_s`; remove one of them")
        return self


class Land(Section):
    """A landing at a position, or at the end of the previous leg."""

    east_m: Metres | None = None
    north_m: Metres | None = None

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.east_m is None) != (self.north_m is None):
            raise ValueError("a position needs both `east_m` and `north_m`")
        return self


class Jump(Section):
    """A jump to a mission entry by its number (from 1); `times`: number of jumps, -1: without end."""

    to: Annotated[int, Field(strict=True, ge=1, le=65_534)]
    times: Annotated[int, Field(strict=True, ge=-1, le=32_767)] = 1


class RawItem(Section):
    """Any mission command, with a position [m] from the start; the frame gives the meaning of z."""

    command: Command
    frame: Annotated[str | int, AfterValidator(partial(mavlink_number, "MAV_FRAME_"))] = "GLOBAL_RELATIVE_ALT"
    param1: Number = 0.0
    param2: Number = 0.0
    param3: Number = 0.0
    param4: Number = 0.0
    east_m: Metres | None = None
    north_m: Metres | None = None
    z: Number = 0.0


def _height_alone(value: Any) -> Any:
    return {"height_m": value} if isinstance(value, int | float) else value


class Leg(OneOf):
    """One entry of a mission."""

    takeoff: (
        Annotated[Takeoff, BeforeValidator(_height_alone, json_schema_input_type=Height | Takeoff)] | None
    ) = None
    waypoint: Waypoint | None = None
    loiter: Loiter | None = None
    speed_m_s: Annotated[float, Field(strict=True, gt=0, le=200)] | None = None
    delay_s: Seconds | None = None
    jump: Jump | None = None
    rtl: NoSettings | None = None
    land: Land | None = None
    item: RawItem | None = None

    @property
    def _raw_command(self) -> int | None:
        return None if self.item is None else mavlink_number("MAV_CMD_", self.item.command)

    @property
    def flown(self) -> bool:
        """Return True for a leg that moves or holds the vehicle; False for a speed or a jump."""
        if self.item is not None:
            return self._raw_command in NAVIGATION
        return self.speed_m_s is None and self.jump is None

    @property
    def lands(self) -> bool:
        """Return True if the vehicle is on the ground after this leg."""
        return self.rtl is not None or self.land is not None or self._raw_command in LANDINGS

    @property
    def returns(self) -> bool:
        return self.rtl is not None or self._raw_command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH

    def place(self) -> tuple[float, float] | None:
        """Return the position of this leg, east and north [m], or None."""
        if not self.flown:  # the position of a region of interest, for example, is no place of the vehicle
            return None
        for where in (self.takeoff, self.waypoint, self.loiter, self.land, self.item):
            if where is not None and where.east_m is not None and where.north_m is not None:
                return where.east_m, where.north_m
        return None


def jump_problem(legs: Sequence[Leg], index: int) -> str:
    """Return the problem with the leg at `index` if the leg is a jump; else an empty text."""
    jump = legs[index].jump
    if jump is None:
        return ""
    if jump.to > len(legs):
        return (
            f"jump: entry {jump.to} does not exist, because the mission has {len(legs)} entries; "
            "to send the jump anyway, use `item: {command: DO_JUMP, param1: ..., param2: ...}`"
        )
    back = jump.to - 1 <= index
    if jump.times < 0 and back and not any(leg.flown for leg in legs[jump.to - 1 : index]):
        return f"jump: endless return to entry {jump.to} without a flown entry; add a waypoint to the loop"
    return ""


class Circle(StartOffset):
    radius_m: Length


class FenceShape(OneOf):
    """One part of a fence; polygons are lists of [east, north] [m] from the vehicle's start."""

    keep_in: Annotated[tuple[tuple[Metres, Metres], ...], Field(min_length=3, max_length=70)] | None = None
    keep_out: Annotated[tuple[tuple[Metres, Metres], ...], Field(min_length=3, max_length=70)] | None = None
    keep_in_circle: Circle | None = None
    keep_out_circle: Circle | None = None

    @model_validator(mode="after")
    def _has_an_inside(self) -> Self:
        corners = self.keep_in or self.keep_out
        if corners is not None and _width_m(corners) < MIN_WIDTH_M:
            raise ValueError("all corners of this polygon are on one line; move one of them")
        return self

    @property
    def inclusion(self) -> bool:
        return self.keep_in is not None or self.keep_in_circle is not None


def _width_m(corners: Sequence[tuple[float, float]]) -> float:
    """Return the largest distance of a corner [m] from the line through the first and the farthest corner."""
    first = corners[0]
    farthest = max(corners, key=lambda corner: math.dist(first, corner))
    length_m = math.dist(first, farthest)
    if length_m == 0:
        return 0.0
    east, north = (farthest[0] - first[0]) / length_m, (farthest[1] - first[1]) / length_m
    return max(abs(east * (c[1] - first[1]) - north * (c[0] - first[0])) for c in corners)


class PlanWriter:
    """The conversion of legs and shapes into MAVLink items around one vehicle's start [deg]."""

    def __init__(self, lat_deg: float, lon_deg: float) -> None:
        self._frame = LocalFrame(lat_deg, lon_deg)

    def place(self, east_m: float, north_m: float) -> tuple[int, int]:
        """Return latitude and longitude [1e-7 deg]."""
        lat_deg, lon_deg = self._frame.point_to_geodetic(east_m, north_m)
        return round(lat_deg * 1e7), round(lon_deg * 1e7)

    def mission(self, legs: Sequence[Leg], *, home_first: bool) -> list[PlanItem]:
        """Return the mission's items; `home_first`: item 0 is a placeholder for home (ArduPilot)."""
        items = [self._item_at(mavlink.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0))] if home_first else []
        first, place = len(items), (0.0, 0.0)
        for leg in legs:
            place = leg.place() or place
            if leg.item is not None:
                items.append(self._raw(leg.item))
                continue
            command, z, params = _command_of(leg, first)
            items.append(self._item_at(command, None if command in WITHOUT_PLACE else place, z, *params))
        return items

    def fence(self, shapes: Sequence[FenceShape]) -> list[PlanItem]:
        items: list[PlanItem] = []
        for shape in shapes:
            polygon, circle = shape.keep_in or shape.keep_out, shape.keep_in_circle or shape.keep_out_circle
            side = "INCLUSION" if shape.inclusion else "EXCLUSION"
            if polygon is not None:
                command = mavlink_number("MAV_CMD_", f"NAV_FENCE_POLYGON_VERTEX_{side}")
                items += [self._vertex(command, len(polygon), *corner) for corner in polygon]
            elif circle is not None:
                command = mavlink_number("MAV_CMD_", f"NAV_FENCE_CIRCLE_{side}")
                items.append(self._vertex(command, circle.radius_m, circle.east_m, circle.north_m))
        return items

    def _vertex(self, command: int, param1: float, east_m: float, north_m: float) -> PlanItem:
        x, y = self.place(east_m, north_m)
        return PlanItem(command, x, y, frame=mavlink.MAV_FRAME_GLOBAL, params=(param1, 0.0, 0.0, 0.0))

    def _item_at(
        self, command: int, place: tuple[float, float] | None, z: float = 0.0, *params: float
    ) -> PlanItem:
        """Return an item at a place, east and north [m], or without a place."""
        param1, param2, param3 = (*params, 0.0, 0.0, 0.0)[:3]
        frame = mavlink.MAV_FRAME_MISSION if place is None else mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
        x, y = (0, 0) if place is None else self.place(*place)
        return PlanItem(command, x, y, z, frame, (param1, param2, param3, 0.0))

    def _raw(self, raw: RawItem) -> PlanItem:
        placed = raw.east_m is not None and raw.north_m is not None
        x, y = self.place(raw.east_m or 0.0, raw.north_m or 0.0) if placed else (0, 0)
        params = (raw.param1, raw.param2, raw.param3, raw.param4)
        command = mavlink_number("MAV_CMD_", raw.command)
        return PlanItem(command, x, y, raw.z, mavlink_number("MAV_FRAME_", raw.frame), params)


def _command_of(leg: Leg, first: int) -> tuple[int, float, tuple[float, ...]]:
    """Return MAV_CMD, z [m] and the first parameters of a leg; `first`: number of the first leg's item."""
    if takeoff := leg.takeoff:
        return mavlink.MAV_CMD_NAV_TAKEOFF, takeoff.height_m, ()
    if waypoint := leg.waypoint:
        return mavlink.MAV_CMD_NAV_WAYPOINT, waypoint.height_m, (waypoint.hold_s,)
    if loiter := leg.loiter:
        command, amount = mavlink.MAV_CMD_NAV_LOITER_UNLIM, 0.0
        if loiter.turns is not None:
            command, amount = mavlink.MAV_CMD_NAV_LOITER_TURNS, loiter.turns
        elif loiter.for_s is not None:
            command, amount = mavlink.MAV_CMD_NAV_LOITER_TIME, loiter.for_s
        return command, loiter.height_m, (amount, 0.0, loiter.radius_m)
    if leg.speed_m_s is not None:
        return mavlink.MAV_CMD_DO_CHANGE_SPEED, 0.0, (mavlink.SPEED_TYPE_GROUNDSPEED, leg.speed_m_s, -1.0)
    if leg.delay_s is not None:
        return mavlink.MAV_CMD_NAV_DELAY, 0.0, (leg.delay_s,)
    if jump := leg.jump:
        return mavlink.MAV_CMD_DO_JUMP, 0.0, (float(jump.to - 1 + first), float(jump.times))
    command = mavlink.MAV_CMD_NAV_LAND if leg.land else mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH
    return command, 0.0, ()
