"""Checks of the section `formations`: members, room, separation, and the range of communication. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations, product

from swarmctl.agent.formation.approaches.place_keeping import MARGIN_M, MARGIN_UP_M
from swarmctl.agent.formation.shape import (
    Shape,
    ShapePlace,
    least_spacing_between_m,
    least_spacing_m,
    radius_m,
    width_m,
)
from swarmctl.agent.formation.view import LOWEST_M
from swarmctl.agent.traffic.route_hold import CEILING_MARGIN_M
from swarmctl.config.communication import vehicle_of
from swarmctl.config.formations import FormationSection
from swarmctl.config.model import Config
from swarmctl.config.problems import ConfigProblem
from swarmctl.config.scenario import GROUP_SPEED, Scenario
from swarmctl.config.specs import Spec, airframes_of
from swarmctl.config.yaml_lines import KeyPath
from swarmctl.links import LINKS

SPARE_M = 3.0
"""Distance beyond the separation that two places at one height keep [m]: members are off their places by as
much."""


def check_formations(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems of names and members: an unknown vehicle, or one in two places or groups."""
    groups: dict[str, int] = {}
    member_of: dict[int, str] = {}
    for i, section in enumerate(config.formations):
        here: KeyPath = ("formations", i)
        if section.name in groups:
            text = f"two groups have the name {section.name}; give each a name of its own"
            yield ConfigProblem((*here, "name"), text)
        groups[section.name] = i
        for j, ref in enumerate(section.members):
            path = (*here, "members", j)
            try:
                uav = vehicle_of(ref, config.names)
            except ValueError as error:
                yield ConfigProblem(path, str(error))
                continue
            if uav in member_of:
                text = f"{ref} is a member of group {member_of[uav]} already; list it once"
                yield ConfigProblem(path, text)
            member_of[uav] = section.name
    if config.formations:
        yield from _check_other_sections(config)


def check_planes_in_groups(config: Config) -> Iterator[ConfigProblem]:
    """Yield the problem of each group with planes."""
    planes = {sysid for sysid, airframe in airframes_of(config).items() if airframe == "plane"}
    names = {str(key) for sysid, name in config.identities if sysid in planes for key in (sysid, name)}
    for i, section in enumerate(config.formations):
        if found := [str(ref) for ref in section.members if str(ref) in names]:
            text = "a place in a shape needs a vehicle that can hover; remove the planes: "
            yield ConfigProblem(("formations", i, "members"), f"{text}{', '.join(found)}")


def _check_other_sections(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems of settings that a group cannot follow."""
    if config.arrival is not None:
        text = "vehicles of a formation arrive as a group; remove this section, or `formations`"
        yield ConfigProblem(("arrival",), text)
    if config.separation.action == "climb":
        text = "a member of a group gives way by a hold; set separation.action: hold"
        yield ConfigProblem(("separation", "action"), text)


def check_groups(scenario: Scenario) -> Iterator[ConfigProblem]:
    """Yield problems of each group: its vehicles, its room, its distances, and its messages."""
    for i, section in enumerate(scenario.config.formations):
        uavs = [vehicle_of(ref, scenario.config.names) for ref in section.members]
        members = [spec for uav in uavs for spec in scenario.swarm if spec.sysid == uav]
        here: KeyPath = ("formations", i)
        yield from _check_members(section, members, here)
        yield from _check_range(scenario, len(members), (*here, "members"))
        shapes = {"shape": section.shape}
        if section.narrow_shape is not None:
            shapes["narrow_shape"] = section.narrow_shape
        if wrong := list(_check_offsets(section, len(members), shapes, here)):
            yield from wrong
            continue
        for key, shape in shapes.items():
            places = shape.places(len(members))
            yield from _check_distances(scenario, section, members, shape, (*here, key))
            yield from _check_room(scenario, shape, places, (*here, key))
            yield from _check_messages(scenario, places, (*here, key))
            if section.heights == "level":
                yield from _check_heights(scenario, members, places, (*here, key))
        yield from _check_change(scenario, section, members, here)
        if section.split_factor is not None:
            yield from _check_split(scenario, section, members, here)


def _check_offsets(
    section: FormationSection, n: int, shapes: Mapping[str, Shape], here: KeyPath
) -> Iterator[ConfigProblem]:
    """Yield problems of a wrong number of offsets, and of heights that have no effect."""
    for key, shape in shapes.items():
        n_offsets = len(shape.offsets_m)
        if shape.kind == "offsets" and n_offsets != n - 1:
            text = f"{n_offsets} offsets: expected {n - 1}, one for each member but the first"
            yield ConfigProblem((*here, key, "offsets_m"), text)
        heights = {"height_step_m": shape.height_step_m, "offsets_m": any(up for *_, up in shape.offsets_m)}
        if section.heights == "stepped" and (used := [name for name, height in heights.items() if height]):
            text = "heights of places have an effect only in a level group; set heights: level, or give 0"
            yield ConfigProblem((*here, key, used[0]), text)


def _check_members(section: FormationSection, members: list[Spec], here: KeyPath) -> Iterator[ConfigProblem]:
    path = (*here, "members")
    if without := _names(spec for spec in members if not LINKS[spec.link].sends_set_points):
        yield ConfigProblem(
            path, f"a member needs a link that sends set-points; set link: direct for {without}"
        )
    if bound := _names(s for s in members if s.arrive_after_s > 0.0 or s.arrive_within_s < math.inf):
        text = f"a group has no time of arrival; remove arrive_after_s and arrive_within_s of {bound}"
        yield ConfigProblem(path, text)
    slowest = min(members, key=lambda spec: spec.speed_m_s)
    if section.speed_m_s is not None and section.speed_m_s >= slowest.speed_m_s:
        text = (
            f"{section.speed_m_s:g} m/s leaves {slowest.name} ({slowest.speed_m_s:g} m/s) no reserve for "
            f"turns; give less, such as {GROUP_SPEED * slowest.speed_m_s:.3g}"
        )
        yield ConfigProblem((*here, "speed_m_s"), text)


def _names(specs: Iterable[Spec]) -> str:
    return ", ".join(spec.name for spec in specs)


def _check_heights(
    scenario: Scenario, members: list[Spec], places: tuple[ShapePlace, ...], path: KeyPath
) -> Iterator[ConfigProblem]:
    """Yield the problem of a member that would fly too low or too high when one of the members leads."""
    low_m, high_m = LOWEST_M, scenario.ceiling_m - CEILING_MARGIN_M
    for leader, (spec, place) in product(members, zip(members, places, strict=True)):
        height_m = leader.altitude_m + place[2]
        if not low_m <= height_m <= high_m:
            limit = f"below {low_m:g} m"
            if height_m > high_m:
                limit = f"less than {CEILING_MARGIN_M:g} m below the fence's ceiling, or above it"
            text = f"with {leader.name} at {leader.altitude_m:g} m, {spec.name} would fly at {height_m:g} m, "
            yield ConfigProblem(path, f"{text}{limit}; change height_step_m, or the offsets' heights")
            return


def _check_distances(
    scenario: Scenario,
    section: FormationSection,
    members: list[Spec],
    shape: Shape,
    path: KeyPath,
) -> Iterator[ConfigProblem]:
    """Yield the problem of two places that are nearer than members keep, over ground and in height."""
    limits = scenario.config.separation
    least_m, least_up_m = limits.horizontal_m + SPARE_M, limits.vertical_m + MARGIN_UP_M
    places = zip(members, shape.places(len(members)), strict=True)
    for (one, a), (other, b) in combinations(places, 2):
        apart_m, up_m = math.dist(a[:2], b[:2]), _up_m(section, one, a, other, b)
        if apart_m < least_m and up_m < least_up_m:
            text = (
                f"the places of {one.name} and {other.name} are {apart_m:.3g} m apart over ground and "
                f"{up_m:.3g} m in height, below the separation and the members' margin ({least_m:g} m and "
                f"{least_up_m:g} m); {_farther_apart(shape, apart_m, least_m)}"
            )
            yield ConfigProblem(path, text)
            return


def _farther_apart(shape: Shape, apart_m: float, least_m: float) -> str:
    """Return the remedy for places that are too near to each other."""
    if shape.kind == "offsets" or apart_m == 0.0:
        return "give other offsets_m"
    needed_m = math.ceil(shape.spacing_m * least_m / apart_m)
    opening = ", or open the wedge" if shape.kind == "wedge" and apart_m < shape.spacing_m else ""
    return f"raise spacing_m to {needed_m:g} m or more{opening}"


def _check_change(
    scenario: Scenario,
    section: FormationSection,
    members: list[Spec],
    here: KeyPath,
) -> Iterator[ConfigProblem]:
    """Yield the problem of two members that come too near while the group changes its shape."""
    if section.narrow_shape is None:
        return
    limits = scenario.config.separation
    least_m, least_up_m = limits.horizontal_m + MARGIN_M, limits.vertical_m + MARGIN_UP_M
    n = len(members)
    ways = zip(members, section.shape.places(n), section.narrow_shape.places(n), strict=True)
    for (one, a, a_to), (other, b, b_to) in combinations(ways, 2):
        apart_m = least_spacing_between_m((a, b), (a_to, b_to))
        up_m = min(_up_m(section, one, a, other, b), _up_m(section, one, a_to, other, b_to))
        if apart_m < least_m and up_m < least_up_m:
            text = (
                f"{one.name} and {other.name} come within {apart_m:.3g} m while the group changes its shape, "
                f"and the members keep {least_m:g} m; raise spacing_m, or name the members in another order"
            )
            yield ConfigProblem((*here, "narrow_shape"), text)
            return


def _check_split(
    scenario: Scenario, section: FormationSection, members: list[Spec], here: KeyPath
) -> Iterator[ConfigProblem]:
    """Yield problems of a group that may split: its measure, and members that may meet at one height."""
    path: KeyPath = (*here, "split_factor")
    if section.exposure != "sum":
        text = "a split is compared by sums of exposure; set exposure: sum, or remove this key"
        yield ConfigProblem(path, text)
    if section.heights == "level":
        text = "members that fly level may meet on own ways; set heights: stepped, or remove this key"
        yield ConfigProblem(path, text)
        return
    least_up_m = scenario.config.separation.vertical_m + MARGIN_UP_M
    for one, other in combinations(members, 2):
        up_m = abs(one.altitude_m - other.altitude_m)
        if up_m < least_up_m:
            text = (
                f"the ways of {one.name} and {other.name} may cross, and they fly {up_m:.3g} m above each "
                f"other, below {least_up_m:g} m; raise flight.altitude_step_m, or remove this key"
            )
            yield ConfigProblem(path, text)
            return


def _up_m(section: FormationSection, one: Spec, a: ShapePlace, other: Spec, b: ShapePlace) -> float:
    """Return the difference in height of two members at these places [m]."""
    return abs(a[2] - b[2]) if section.heights == "level" else abs(one.altitude_m - other.altitude_m)


def _check_room(
    scenario: Scenario, shape: Shape, places: tuple[ShapePlace, ...], path: KeyPath
) -> Iterator[ConfigProblem]:
    """Yield the problem of a shape that is wider than the area, or than the fence around it."""
    grid = scenario.grid
    corners = [grid.frame.to_local(*corner) for corner in scenario.fence_polygon]
    fence_m = min(max(axis) - min(axis) for axis in zip(*corners, strict=True))
    extent_m = max(width_m(places), radius_m(places))
    for what, room_m in (("area", min(grid.size_east_m, grid.size_north_m)), ("fence", fence_m)):
        if extent_m > room_m:
            key = "offsets_m" if shape.kind == "offsets" else "spacing_m"
            text = f"the shape is {extent_m:.4g} m wide, and the {what} {room_m:.4g} m; lower {key}"
            yield ConfigProblem(path, text)
            return


def _check_messages(
    scenario: Scenario, places: tuple[ShapePlace, ...], path: KeyPath
) -> Iterator[ConfigProblem]:
    """Yield the problem of messages that do not reach from one end to the other, or not the neighbours."""
    c = scenario.config.communication
    extent_m = max((math.dist(a[:2], b[:2]) for a, b in combinations(places, 2)), default=0.0)
    if c.max_distance_m is not None and extent_m > c.max_distance_m:
        text = (
            f"the ends of the shape are {extent_m:.4g} m apart, and messages reach {c.max_distance_m:g} m; "
            "lower spacing_m, or raise communication.max_distance_m"
        )
        yield ConfigProblem(path, text, depends_on=("communication", "max_distance_m"))
    nearest_m = least_spacing_m(places)
    if c.min_distance_m > nearest_m:
        text = f"members {nearest_m:.3g} m apart hear nothing below communication.min_distance_m = "
        text += f"{c.min_distance_m:g} m; lower that key, or raise spacing_m"
        yield ConfigProblem(path, text, depends_on=("communication", "min_distance_m"))


def _check_range(scenario: Scenario, n: int, path: KeyPath) -> Iterator[ConfigProblem]:
    """Yield the problem of messages that reach fewer vehicles than a member has others."""
    reach = scenario.config.communication.range
    if reach != "all" and reach < n - 1:
        text = (
            f"a message reaches {reach} vehicles, and each member has {n - 1} others; raise "
            f"communication.range to {n - 1} or more, or write all"
        )
        yield ConfigProblem(path, text, depends_on=("communication", "range"))
