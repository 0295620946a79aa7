"""Shapes: the places of a group's members, as offsets from the group's reference point. Pure.

The members take the places in the order of the configuration. Place 0 is the reference point, the leader's
place. In shapes with two sides the odd places are on the right and the even places on the left.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Literal

from pydantic import Field, model_validator

from swarmctl.core.planar import distance_to_leg
from swarmctl.core.section import Section

ShapePlace = tuple[float, float, float]
"""forward, right, up of the reference point [m]"""

ShapeKind = Literal["wedge", "line", "column", "circle", "offsets"]
REFERENCE_PLACE: ShapePlace = (0.0, 0.0, 0.0)


class Shape(Section):
    """The shape of a group."""

    kind: ShapeKind = Field(
        "wedge",
        description="wedge: a V behind the leader. line: abreast, the leader in the middle. column: one "
        "behind the other. circle: a ring whose foremost member is the leader. offsets: given places.",
    )
    spacing_m: float = Field(
        30.0, gt=0.0, description="Distance over ground between neighbours [m]; not of the kind offsets."
    )
    opening_deg: float = Field(
        90.0, gt=0.0, le=180.0, description="Angle between the arms of a wedge [deg]; 180: a line."
    )
    height_step_m: float = Field(
        0.0, description="Difference of height from each place to the next, in the order of members [m]."
    )
    offsets_m: tuple[ShapePlace, ...] = Field(
        (),
        description="Places [forward, right, up] of the kind offsets from the second member on [m]; the "
        "first member is at [0, 0, 0].",
    )

    @model_validator(mode="after")
    def _numbers_fit_the_kind(self) -> Shape:
        if self.kind == "offsets" and not self.offsets_m:
            raise ValueError("the kind `offsets` needs `offsets_m`")
        if self.kind == "offsets":
            unused = ["opening_deg", "spacing_m", "height_step_m"]
        else:
            unused = ["offsets_m"] if self.kind == "wedge" else ["offsets_m", "opening_deg"]
        for name in unused:
            # A recorded configuration has all defaults.
            if getattr(self, name) != type(self).model_fields[name].default:
                raise ValueError(f"`{name}` has no effect on the kind `{self.kind}`; remove it")
        return self

    @property
    def n_most(self) -> int:
        """Greatest number of members for which the shape has places."""
        return 1 + len(self.offsets_m) if self.kind == "offsets" else sys.maxsize

    def places(self, n: int) -> tuple[ShapePlace, ...]:
        """Return the places of `n` members. Raises ValueError if `offsets_m` has too few."""
        if self.kind == "offsets":
            if (found := len(self.offsets_m)) < n - 1:
                raise ValueError(f"{found} offsets: expected {n - 1}, one for each member but the first")
            return (REFERENCE_PLACE, *self.offsets_m)[:n]
        flat = _FLAT[self.kind](n, self.spacing_m, math.radians(self.opening_deg))
        return tuple((forward, right, k * self.height_step_m) for k, (forward, right) in enumerate(flat))


def assigned(present: Sequence[bool], *, closes_up: bool) -> tuple[int | None, ...]:
    """Return the number of each member's place, None for an absent member; in the order of the members.

    A group that closes up fills its first places in order. Otherwise the place of an absent member stays
    open, so the leader may have another place than 0.
    """
    if not closes_up:
        return tuple(k if here else None for k, here in enumerate(present))
    before = [sum(present[:k]) for k in range(len(present))]
    return tuple(n if here else None for n, here in zip(before, present, strict=True))


def least_spacing_m(of: Sequence[ShapePlace], apart_in_height_m: float = math.inf) -> float:
    """Return the least distance over ground between two places [m]; infinite for fewer than two.

    Places whose heights differ by `apart_in_height_m` or more do not count.
    """
    pairs = ((a, b) for a, b in combinations(of, 2) if abs(a[2] - b[2]) < apart_in_height_m)
    return min((math.dist(a[:2], b[:2]) for a, b in pairs), default=math.inf)


def least_spacing_between_m(before: Sequence[ShapePlace], after: Sequence[ShapePlace]) -> float:
    """Return the least distance over ground while all members move evenly from one shape to another [m].

    Both shapes have the same number of places. Each member moves straight, and all arrive together.
    """
    least = math.inf
    for (a, a_to), (b, b_to) in combinations(zip(before, after, strict=True), 2):
        begin, end = (b[0] - a[0], b[1] - a[1]), (b_to[0] - a_to[0], b_to[1] - a_to[1])
        least = min(least, distance_to_leg((0.0, 0.0), begin, end))
    return least


def radius_m(of: Sequence[ShapePlace]) -> float:
    """Return the greatest distance over ground of a place from the reference point [m]."""
    return max((math.hypot(forward, right) for forward, right, _ in of), default=0.0)


def width_m(of: Sequence[ShapePlace]) -> float:
    """Return the distance across the direction of flight between the outermost places [m]."""
    return max(right for _, right, _ in of) - min(right for _, right, _ in of) if of else 0.0


def _sides(n: int) -> list[tuple[int, int]]:
    """Return (rank, side) of each place: side 1 is right, −1 left, and 0 the leader's."""
    return [((k + 1) // 2, 0 if k == 0 else 1 if k % 2 else -1) for k in range(n)]


def _wedge(n: int, spacing_m: float, opening_rad: float) -> list[tuple[float, float]]:
    back, out = spacing_m * math.cos(opening_rad / 2.0), spacing_m * math.sin(opening_rad / 2.0)
    return [(-rank * back if rank else 0.0, rank * side * out) for rank, side in _sides(n)]


def _line(n: int, spacing_m: float, _opening_rad: float) -> list[tuple[float, float]]:
    return [(0.0, rank * side * spacing_m) for rank, side in _sides(n)]


def _column(n: int, spacing_m: float, _opening_rad: float) -> list[tuple[float, float]]:
    return [(-k * spacing_m if k else 0.0, 0.0) for k in range(n)]


def _circle(n: int, spacing_m: float, _opening_rad: float) -> list[tuple[float, float]]:
    """Return places on a ring with the reference point in front: with four the diamond of Balch and Arkin.

    All members are on the ring, as in formations that surround something. The leader is not in its centre:
    there it would have no neighbour at the spacing, and a lost leader would leave a ring without a centre.
    """
    if n < 2:
        return [(0.0, 0.0)] * n
    ring_m = spacing_m / (2.0 * math.sin(math.pi / n))
    angles = (side * rank * 2.0 * math.pi / n for rank, side in _sides(n))
    return [(ring_m * (math.cos(angle) - 1.0), ring_m * math.sin(angle)) for angle in angles]


_FLAT: dict[str, Callable[[int, float, float], list[tuple[float, float]]]] = {
    "wedge": _wedge,
    "line": _line,
    "column": _column,
    "circle": _circle,
}
