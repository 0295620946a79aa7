"""Checks: named conditions on each vehicle, evaluated at every tick of a run or at its end.

A check is a function of the `RunView` and the check's argument. The function returns n results (True: the
condition holds) and n measured values or texts. A new check is one more function in this file.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import ge, gt, le
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.scenarios.base import Number, Probability
from sim_vehicle.truth import Truth

Bools = npt.NDArray[np.bool_]
When = Literal["always", "eventually", "end"]
Need = Literal["goal", "fence", "area", "mission", "hostiles", "others"]
Measured = Floats | Sequence[str]
AtLeast0 = Annotated[Number, Field(ge=0)]
Words = Annotated[str, Field(pattern=r"\S")]
# the argument of the checks of an area and a fence
MARGIN = {"argument": "margin_m", "default": 0.0, "unit": "m outside", "type": AtLeast0}


@dataclass(frozen=True)
class RunView:
    """The input of checks: true states and received messages, arrays of n vehicles in the scenario's order.

    Positions are metres east, north, up (above mean sea level) in one local plane for all vehicles.
    """

    now: float
    truth: Truth
    position_m: Floats  # (n, 3)
    start_m: Floats  # (n, 3)
    goal_m: Floats  # (n, 2), NaN without a goal
    bound_for_goal: Bools  # the mission item of the goal is current or past; True without such an item
    flown: Bools  # True after the first take-off
    heartbeat_age_s: Floats  # time since the last heartbeat; before the first heartbeat, since the start
    mission_done: Bools
    outside_fence_m: Floats  # distance beyond the fence, 0 inside
    area_m: tuple[float, float, float, float] | None  # west, south, east, north edges
    texts: Sequence[Sequence[str]]  # each vehicle's STATUSTEXTs, assembled from chunks

    @cached_property
    def height_m(self) -> Floats:
        """Return the height above the start [m]."""
        return self.position_m[:, 2] - self.start_m[:, 2]

    @cached_property
    def from_start_m(self) -> Floats:
        return _distance(self.position_m, self.start_m)

    @cached_property
    def from_goal_m(self) -> Floats:
        return _distance(self.position_m, self.goal_m)

    @cached_property
    def separation_m(self) -> Floats:
        """Return the distance to the nearest other airborne vehicle [m]; infinite on the ground or alone."""
        from scipy.spatial import KDTree  # noqa: PLC0415 (saves 0.1 s at every start)

        found = np.full(len(self.position_m), np.inf)
        flying = np.flatnonzero(self.truth.airborne)
        if len(flying) > 1:
            places = self.position_m[flying]
            distances = np.asarray(KDTree(places).query(places, k=2)[0])
            found[flying] = distances[:, 1]
        return found

    @cached_property
    def outside_area_m(self) -> Floats:
        if self.area_m is None:
            return np.zeros(len(self.position_m))
        west, south, east, north = self.area_m
        x, y = self.position_m[:, 0], self.position_m[:, 1]
        return np.hypot(
            np.maximum(0, np.maximum(west - x, x - east)), np.maximum(0, np.maximum(south - y, y - north))
        )

    def received_text(self, words: str) -> Bools:
        """Return True for each vehicle that sent a text with these words; upper and lower case are equal."""
        wanted = words.casefold()
        return np.array([any(wanted in text.casefold() for text in texts) for texts in self.texts])


def _distance(a: Floats, b: Floats) -> Floats:
    distance: Floats = np.hypot(a[:, 0] - b[:, 0], a[:, 1] - b[:, 1])
    return distance


CheckFunction = Callable[[RunView, Any], tuple[Bools, Measured]]
AwayFunction = Callable[[RunView], Floats]


@dataclass(frozen=True, slots=True)
class Check:
    """A check and its description for authors of scenarios."""

    name: str
    summary: str
    when: When
    function: CheckFunction
    argument: str | None = None  # name of the argument; None: without an argument
    default: float | str | None = None  # None: the argument must be given
    type: Any = Number  # of the argument, for pydantic
    unit: str = ""
    needs: Need | None = None
    away_m: AwayFunction | None = None  # distance to the event [m]; inf while no event is expected


CHECKS: dict[str, Check] = {}


def check(when: When, argument: str | None = None, **fields: Any) -> Callable[[CheckFunction], CheckFunction]:
    """Register a check; the function's name and docstring are the check's name and summary.

    fields: further fields of `Check`.
    """

    def register(function: CheckFunction) -> CheckFunction:
        name, summary = function.__name__, (function.__doc__ or "").strip()
        CHECKS[name] = Check(name, summary, when, function, argument, **fields)
        return function

    return register


@check("always")
def no_crash(view: RunView, _: None) -> tuple[Bools, Measured]:
    """The vehicle has not hit the ground too hard."""
    return ~view.truth.crashed, ["crashed" if broken else "undamaged" for broken in view.truth.crashed]


@check("eventually")
def crashed(view: RunView, _: None) -> tuple[Bools, Measured]:
    """The vehicle has hit the ground too hard."""
    return view.truth.crashed, ["crashed" if broken else "undamaged" for broken in view.truth.crashed]


def _limit_check(
    name: str, summary: str, measure: Callable[[RunView], Floats], keeps: Callable[[Any, Any], Any]
) -> CheckFunction:
    """Return a check: the measured values keep the limit, which is the check's argument."""

    def function(view: RunView, limit: float | None) -> tuple[Bools, Measured]:
        values = measure(view)
        return keeps(values, limit or 0.0), values

    function.__name__, function.__doc__ = name, summary
    return function


_LIMITS: tuple[
    tuple[str, str, Callable[[RunView], Floats], Callable[[Any, Any], Any], dict[str, Any]], ...
] = (
    ("min_separation_m",
     "In the air the vehicle is at least this far from the nearest other airborne vehicle.",
     lambda v: v.separation_m, ge, {"argument": "metres", "unit": "m", "needs": "others",
      "type": Annotated[Number, Field(ge=0.1)]}),
    ("max_height_m", "The vehicle is at most this high above its start.",
     lambda v: v.height_m, le, {"argument": "metres", "unit": "m"}),
    ("min_height_m", "The vehicle is at least this high above its start (give `from_s` and `until_s`).",
     lambda v: v.height_m, ge, {"argument": "metres", "unit": "m"}),
    ("max_speed_m_s", "The vehicle is at most this fast over the ground.",
     lambda v: v.truth.speed_m_s, le, {"argument": "speed", "unit": "m/s", "type": AtLeast0}),
    ("stays_within_m", "The vehicle stays within this distance of its start.",
     lambda v: v.from_start_m, le, {"argument": "metres", "unit": "m", "type": AtLeast0}),
    ("stays_in_area", "The vehicle does not leave the scenario's area by more than the margin.",
     lambda v: v.outside_area_m, le, {**MARGIN, "needs": "area"}),
    ("no_fence_breach", "The vehicle does not cross its fence by more than the margin.",
     lambda v: v.outside_fence_m, le, {**MARGIN, "needs": "fence"}),
    ("battery_above", "The battery has more than this share of the full charge.",
     lambda v: v.truth.battery_remaining, gt,
     {"argument": "share", "unit": "of the charge", "type": Probability}),
    ("no_strike", "No hostile has hit the vehicle.",
     lambda v: v.truth.strikes.astype(float), le, {"needs": "hostiles"}),
    ("strikes_at_most", "Hostiles have hit the vehicle at most this often.",
     lambda v: v.truth.strikes.astype(float), le,
     {"argument": "count", "unit": "strikes", "needs": "hostiles", "type": AtLeast0}),
    ("alive", "The time since the vehicle's last heartbeat is at most this long.",
     lambda v: v.heartbeat_age_s, le,
     {"argument": "silence_s", "default": 3.0, "unit": "s silent", "type": AtLeast0}),
)  # fmt: skip
for _name, _summary, _measure, _keeps, _settings in _LIMITS:
    check("always", **_settings)(_limit_check(_name, _summary, _measure, _keeps))


@check("always", "words", type=Words)
def never_says(view: RunView, words: str) -> tuple[Bools, Measured]:
    """The ground station receives no text with these words."""
    received = view.received_text(words)
    return ~received, ["received" if text else "not received" for text in received]


@check("eventually", "words", type=Words)
def heard_text(view: RunView, words: str) -> tuple[Bools, Measured]:
    """The ground station receives a text with these words."""
    received = view.received_text(words)
    return received, ["received" if text else "not received" for text in received]


@check("eventually", "mode", type=Words)
def mode_is(view: RunView, mode: str) -> tuple[Bools, Measured]:
    """The vehicle is in this mode, or in one of several modes (`RTL|Return`)."""
    wanted = mode.casefold().split("|")
    return np.array([now.casefold() in wanted for now in view.truth.mode]), view.truth.mode


@check("eventually")
def armed(view: RunView, _: None) -> tuple[Bools, Measured]:
    """The vehicle is armed."""
    return view.truth.armed, ["armed" if is_armed else "disarmed" for is_armed in view.truth.armed]


@check("end")
def disarmed(view: RunView, _: None) -> tuple[Bools, Measured]:
    """The vehicle is disarmed."""
    return ~view.truth.armed, ["armed" if is_armed else "disarmed" for is_armed in view.truth.armed]


@check("eventually", unit="m high")
def airborne(view: RunView, _: None) -> tuple[Bools, Measured]:
    """The vehicle is in the air."""
    return view.truth.airborne, view.height_m


@check("eventually")
def landed(view: RunView, _: None) -> tuple[Bools, Measured]:
    """The vehicle has flown and is on the ground, undamaged and disarmed."""
    return _on_ground_undamaged(view) & ~view.truth.armed, [
        "crashed"
        if view.truth.crashed[i]
        else f"{high:.4g} m high, {'armed' if view.truth.armed[i] else 'disarmed'}"
        f"{'' if view.flown[i] else ', not flown yet'}"
        for i, high in enumerate(view.height_m)
    ]


@check("end", "metres", type=AtLeast0)
def lands_within_m(view: RunView, metres: float) -> tuple[Bools, Measured]:
    """The vehicle has flown and is on the ground, undamaged, within this distance of its start."""
    return _on_ground_undamaged(view) & (view.from_start_m <= metres), [
        f"{far:.4g} m from its start{', crashed' if view.truth.crashed[i] else ''}"
        f"{', in the air' if view.truth.airborne[i] else ''}{'' if view.flown[i] else ', not flown yet'}"
        for i, far in enumerate(view.from_start_m)
    ]


def _on_ground_undamaged(view: RunView) -> Bools:
    return view.flown & ~view.truth.airborne & ~view.truth.crashed


def _distance_to_goal_m(view: RunView) -> Floats:
    return np.where(view.flown & view.bound_for_goal, view.from_goal_m, np.inf)


@check("eventually", "within_m", default=5.0, needs="goal", type=AtLeast0, away_m=_distance_to_goal_m)
def reached_goal(view: RunView, within_m: float) -> tuple[Bools, Measured]:
    """The vehicle has flown and is within this distance of `goal`, or of its mission's last position."""
    reached = view.flown & view.bound_for_goal & (view.from_goal_m <= within_m)
    reason = np.where(view.bound_for_goal, "", ", not bound for the goal yet")
    reason = np.where(view.flown, reason, ", not flown yet")
    return reached, [f"{far:.4g} m away{text}" for far, text in zip(view.from_goal_m, reason, strict=True)]


@check("eventually", needs="mission")
def mission_complete(view: RunView, _: None) -> tuple[Bools, Measured]:
    """The vehicle has flown and its mission is complete (PX4: the last item is reached)."""
    complete = view.flown & view.mission_done
    return complete, ["complete" if done else "not complete" for done in complete]
