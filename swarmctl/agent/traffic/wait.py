"""The wait of a vehicle for other vehicles: one record, one deadline, and one function that ends it. Pure.

RULES is the table of all waits; `docs/traffic.md` shows it. A vehicle has one wait at a time, which ends with
the phases to which it belongs (`AgentState.enter`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from enum import Enum, StrEnum

import msgspec

from swarmctl.agent.phases import Phase
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace


class WaitFor(StrEnum):
    """The purposes of a wait."""

    FIRST_ROUTE = "first route"
    ROUTE = "route"
    DESCENT = "descent"
    RETURN_PATH = "return path"
    GROUND = "ground"
    TURN = "turn"


class WaitRule(msgspec.Struct, frozen=True):
    where: str
    longest_s: float
    """time from the start of the wait to its deadline [s]"""
    phases: frozenset[Phase]
    least_s: float = 0.0
    """shortest wait [s]: time to stop, and to send the new intent to other vehicles"""
    check_every_s: float = 1.0
    report_every_s: float = math.inf
    """interval of messages to the operator [s]"""


RULES: Mapping[WaitFor, WaitRule] = {
    WaitFor.FIRST_ROUTE: WaitRule(
        "on the ground",
        180.0,
        frozenset({Phase.STANDBY, Phase.LAUNCHING}),
        check_every_s=0.0,
    ),
    WaitFor.ROUTE: WaitRule(
        "in hold on its route",
        300.0,
        frozenset({Phase.FLYING}),
        least_s=3.0,
        report_every_s=60.0,
    ),
    WaitFor.DESCENT: WaitRule(
        "in hold above its landing spot",
        300.0,
        frozenset({Phase.LANDING}),
        least_s=3.0,
        check_every_s=0.2,
        report_every_s=60.0,
    ),
    WaitFor.RETURN_PATH: WaitRule(
        "in hold before its return",
        120.0,
        frozenset({Phase.HOLDING, Phase.LEAVING}),
    ),
    WaitFor.GROUND: WaitRule(
        "in hold before an ordered landing",
        120.0,
        frozenset({Phase.HOLDING, Phase.LEAVING}),
    ),
    WaitFor.TURN: WaitRule(
        "in hold until its turn in a recall",
        math.inf,
        frozenset({Phase.HOLDING}),
        least_s=math.inf,
    ),
}
"""The deadline of a turn is the start time in the recall."""


WAITS_ABOVE_M = 5.0
"""Height above home below which a vehicle lands or leaves without waiting [m]."""
PASSES_WITHIN_S = 10.0
"""Longest wait under an urgent failsafe, from its first begin [s]: another vehicle may pass just below, or
through the way home."""
GOES_SECOND_AFTER_S = 2.5
"""Time for which the way has to be clear if another vehicle waits, too, and goes first [s]: the first vehicle
has announced its new flight by then, also if a message is lost."""
SETTLES_S = 5.0
"""Time after the end of a wait in which the same wait may go on, with its deadline [s]."""


class Verdict(Enum):
    WAIT = "wait"
    """the wait goes on: it is no time for a check, or another vehicle goes first"""
    BLOCKED = "blocked"
    """the wait goes on after a check"""
    CLEAR = "clear"
    """nobody is in the way any more"""
    OVER = "over"
    """the deadline is reached"""


class Wait(msgspec.Struct, frozen=True):
    """A wait; times are by the vehicle's clock."""

    purpose: WaitFor
    since_boot_s: float
    deadline_boot_s: float
    mission: PlannedMission | None = None
    """mission that the hold interrupted; None: the wait interrupts no mission"""
    to: frozenset[int] = frozenset()
    """system ids of the vehicles to which this vehicle gives way"""
    checked_boot_s: float = -math.inf
    clear_boot_s: float | None = None
    """time since which all checks were clear; None: the last one was not"""
    reported_boot_s: float = -math.inf
    """time of the last message about this wait"""
    by_stored: bool = False
    """True: the vehicle may go on by its stored mission, without a new plan"""
    ended_boot_s: float | None = None
    """time at which the vehicle went on, while it may still have to wait again; None: it waits"""

    @property
    def rule(self) -> WaitRule:
        return RULES[self.purpose]

    def description(self, now_s: float, name_of: Callable[[int], str]) -> str:
        """Return the wait in words; `name_of` gives the names of the other vehicles."""
        others = ", ".join(map(name_of, sorted(self.to)))
        text = f"{self.rule.where}, for {others}" if others else self.rule.where
        left_s = self.deadline_boot_s - now_s
        return text if left_s == math.inf else f"{text}, for at most {max(left_s, 0.0):.0f} s"

    @property
    def is_on(self) -> bool:
        """True while the vehicle waits; False: it has gone on, and may have to wait again."""
        return self.ended_boot_s is None

    def may_go_on(self, now_s: float) -> bool:
        """Return whether the wait is on, or has ended at most SETTLES_S ago."""
        return 0.0 <= now_s - (now_s if self.ended_boot_s is None else self.ended_boot_s) < SETTLES_S

    def ended(self, now_s: float) -> Wait:
        """Return the wait of a vehicle that goes on, and may have to wait again until the same deadline."""
        return replace(self, ended_boot_s=now_s)

    def over(self, now_s: float) -> Wait:
        """Return the wait of a vehicle that goes on, and does not wait again."""
        return replace(self, ended_boot_s=now_s, deadline_boot_s=now_s)

    def again(self) -> Wait:
        """Return the wait of a vehicle that has to wait again; its deadline stays."""
        return replace(self, ended_boot_s=None, clear_boot_s=None)

    def is_report_due(self, now_s: float) -> bool:
        return now_s - max(self.reported_boot_s, self.since_boot_s) >= self.rule.report_every_s

    def reported(self, now_s: float) -> Wait:
        return replace(self, reported_boot_s=now_s)


def begin_wait(
    purpose: WaitFor,
    now_s: float,
    *,
    until_s: float = math.inf,
    mission: PlannedMission | None = None,
    to: frozenset[int] = frozenset(),
    by_stored: bool = False,
    before: Wait | None = None,
) -> Wait:
    """Return a new wait, at most until `until_s`. A wait `before`, hardly over, goes on with its deadline."""
    if before is not None and before.purpose is purpose and before.may_go_on(now_s):
        before = replace(before.again(), by_stored=by_stored or before.by_stored, to=before.to | to)
        return replace(before, since_boot_s=now_s, mission=mission, checked_boot_s=now_s)
    deadline_s = min(now_s + RULES[purpose].longest_s, until_s)
    return Wait(purpose, now_s, deadline_s, mission, to, checked_boot_s=now_s, by_stored=by_stored)


def verdict(
    wait: Wait,
    now_s: float,
    is_clear: Callable[[], bool],
    *,
    early_s: float = 0.0,
    goes_second: Callable[[], bool] = lambda: False,
    urgent: bool = False,
) -> tuple[Verdict, Wait]:
    """Return whether a wait ends now, and the wait after a check.

    `is_clear` is asked at most once each `check_every_s`.
    `goes_second`, asked while the way is clear: another vehicle waits, too, and goes first.
    `urgent`: an urgent failsafe demands the end of the wait; it lasts PASSES_WITHIN_S at most.

    The deadline comes `early_s` earlier. After a reboot the vehicle's clock is before the start of the wait,
    and the wait is over.
    """
    rule, until_s = wait.rule, wait.deadline_boot_s - early_s
    if urgent:
        until_s = min(until_s, wait.deadline_boot_s - rule.longest_s + PASSES_WITHIN_S)
    if not wait.since_boot_s <= now_s < until_s:
        return Verdict.OVER, wait
    is_new = now_s - wait.since_boot_s < rule.least_s
    if is_new or 0.0 <= now_s - wait.checked_boot_s < rule.check_every_s:
        return Verdict.WAIT, wait
    if not is_clear():
        return Verdict.BLOCKED, replace(wait, checked_boot_s=now_s, clear_boot_s=None)
    since_s = now_s if wait.clear_boot_s is None else wait.clear_boot_s
    wait = replace(wait, checked_boot_s=now_s, clear_boot_s=since_s)
    is_soon = now_s - since_s < GOES_SECOND_AFTER_S and goes_second()
    return (Verdict.WAIT if is_soon else Verdict.CLEAR), wait
