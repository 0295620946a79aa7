"""Runs checks on one vehicle, in order, and brings it into the state each of them begins in."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from sim_vehicle.conformance import flying
from sim_vehicle.conformance.facts import Facts
from sim_vehicle.conformance.guard import ARM, PLAN_NAMES, SIMULATOR
from sim_vehicle.conformance.parameters import has, put_back, read, write
from sim_vehicle.conformance.peer import Peer, is_autopilot
from sim_vehicle.conformance.plans import FENCE, MISSION, RALLY, Backup
from sim_vehicle.conformance.registry import Check
from sim_vehicle.conformance.words import CheckFailed, Skip

SILENCE_S = 5.0  # without a heartbeat after a check: it harmed the vehicle
BACK_S = 60.0  # a vehicle that is to be left as it was found is waited for so long
LEAVE_ATTEMPTS = 3  # whoever interrupts again and again does not want to wait for it
DOWN_ATTEMPTS = 3
# The categories that overwrite plans, with those they cannot do without; `Peer` sees to it that none is
# overwritten of which there is no copy.
WRITES_PLANS = {
    "modes": (MISSION,), "mission": (MISSION,), "fence": (FENCE,), "rally": (RALLY,), "robustness": (),
    "arming": (), "flight": (MISSION,), "mission-flight": (MISSION,), "reboot": (), "endurance": (),
}  # fmt: skip
FLIES = frozenset({"flight", "mission-flight"})
LOW_BATTERY = 20  # %
RUN_MAH = 30_000.0  # more than all flights of a run take
BOOTING_S = 5.0
BETWEEN_S = 400.0  # for getting up or down between checks


class Outcome(Enum):
    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class Result:
    """What came of one check; `seen` says it in words, `took_s` is vehicle time."""

    check: Check
    outcome: Outcome
    seen: str
    took_s: float


@dataclass(frozen=True, slots=True)
class Report:
    """A whole run; `notes` is what the operator should know beside the results."""

    facts: Facts
    results: tuple[Result, ...]
    notes: tuple[str, ...]
    interrupted: bool = False

    def count(self, outcome: Outcome) -> int:
        return sum(result.outcome is outcome for result in self.results)

    @property
    def passed(self) -> bool:
        return self.count(Outcome.FAILED) == 0


def permissions(facts: Facts, allow: frozenset[str], *, ground_only: bool) -> frozenset[str]:
    """What may be done: everything to the simulator, to any other vehicle only what was allowed by name."""
    granted = allow - {SIMULATOR}
    if facts.simulator:
        granted = granted | {"arm", "reboot", "alter", SIMULATOR}
    return granted - {ARM} if ground_only else granted


def run(
    peer: Peer,
    checks: Sequence[Check],
    *,
    on_result: Callable[[Result], None] = lambda _result: None,
    on_interrupt: Callable[[], None] = lambda: None,
) -> Report:
    """Run the checks on the vehicle that `peer` has met.

    A vehicle that is armed already is somebody else's: nothing is done to it. However the run ends, by the
    operator too, the vehicle is brought down and put back as it was before the report; only who interrupts
    that again and again is obeyed.
    """
    running = _Run(peer, on_result)
    if peer.armed:
        running.over = "the vehicle was armed before the suite began"
        running.others = True
    else:
        _let_boot(peer)
    interrupted = False
    try:
        for check in checks:
            running.take(check)
    except KeyboardInterrupt:
        interrupted = True
        on_interrupt()
    except BaseException:
        # A bug, or nobody to report to: the vehicle may fly all the same.
        running.leave()
        raise
    notes = [f"interrupted {LEAVE_ATTEMPTS} times while the vehicle was put back: it may fly, or be changed"]
    for _ in range(LEAVE_ATTEMPTS):
        try:
            notes = running.leave()
            break
        except KeyboardInterrupt:
            interrupted = True
            on_interrupt()
    return Report(peer.facts, tuple(running.results), tuple(notes), interrupted)


class _Run:
    """What is known while the checks run."""

    def __init__(self, peer: Peer, on_result: Callable[[Result], None]) -> None:
        self._peer, self._on_result = peer, on_result
        self._backup: Backup | None = None
        self._battery_seen = False
        self._told: set[int] = set()  # plans that could not be saved, and a check has failed for it
        self.results: list[Result] = []
        self.over: str | None = None  # why nothing more can be checked
        self.others = False  # somebody else flies it

    def take(self, check: Check) -> None:
        """One check, or the reason why not."""
        reason = self.over if self.over is not None else _why_not(self._peer, check)
        result = Result(check, Outcome.SKIPPED, reason, 0.0) if reason is not None else self._one(check)
        self.results.append(result)
        self._on_result(result)

    def _one(self, check: Check) -> Result:
        if self._backup is None and check.category in WRITES_PLANS:
            self._peer.fresh()
            self._backup = Backup(self._peer)
            self._backup.take()
        unsaved = self._unsaved(check)
        if unsaved is not None:
            return unsaved
        if not self._battery_seen and check.category in FLIES and SIMULATOR in self._peer.permits:
            self._battery_seen = True
            _enlarge_battery(self._peer)
        result = _one(self._peer, check)
        if not _alive(self._peer):
            self.over = f"the vehicle fell silent after {check.name}"
            return Result(check, Outcome.FAILED, f"{result.seen}; then no heartbeat", result.took_s)
        return result

    def _unsaved(self, check: Check) -> Result | None:
        """What comes of a check that would overwrite a plan of which there is no copy."""
        lost = self._backup.lost if self._backup is not None else {}
        for kind in WRITES_PLANS.get(check.category, ()):
            if kind in lost:
                # That a plan cannot be read is a failure, but one is enough.
                outcome = Outcome.SKIPPED if kind in self._told else Outcome.FAILED
                self._told.add(kind)
                return Result(check, outcome, f"its {PLAN_NAMES[kind]} could not be saved: {lost[kind]}", 0.0)
        return None

    def leave(self) -> list[str]:
        """Leave the vehicle as it was found; what the operator should know, in words."""
        notes = [self.over] if self.over is not None else []
        if self.others:
            return notes
        self._peer.fresh()
        if self._backup is not None:
            notes += [
                f"the {PLAN_NAMES[kind]} could not be saved, and was left alone: {why}"
                for kind, why in self._backup.lost.items()
            ]
        return notes + _leave(self._peer, self._backup)


def _let_boot(peer: Peer) -> None:
    """Give a vehicle that has just booted its first seconds, in which a mode that is set does not stay."""
    try:
        age_s = peer.request("SYSTEM_TIME").time_boot_ms / 1000
    except (CheckFailed, Skip):
        return
    peer.wait(max(0.0, BOOTING_S - age_s))


def _why_not(peer: Peer, check: Check) -> str | None:
    """Why a check does not apply or is not allowed."""
    if check.dialects and peer.dialect.name not in check.dialects:
        return f"only for {', '.join(sorted(check.dialects))}"
    if check.kind is not None and peer.facts.kind != check.kind:
        return f"only for a {check.kind}"
    for capability in check.claims:
        if not peer.facts.claims(capability):
            return f"does not claim {capability}"
    missing = check.needs - peer.permits
    if SIMULATOR in missing:
        return "only for the simulator"
    if missing:
        return f"not allowed: takes {' '.join(f'--allow-{name}' for name in sorted(missing))}"
    return None


def _one(peer: Peer, check: Check) -> Result:
    """Prepare, run, judge."""
    began_s = peer.now
    try:
        _settle(peer, check)
    except CheckFailed as error:
        return Result(check, Outcome.FAILED, f"could not begin: {error}", peer.now - began_s)
    except Skip as reason:
        return Result(check, Outcome.SKIPPED, f"could not begin: {reason}", peer.now - began_s)
    began_s = peer.now
    peer.fresh(check.limit_s)
    try:
        outcome, seen = Outcome.PASSED, check.function(peer)
    except CheckFailed as error:
        outcome, seen = Outcome.FAILED, str(error)
        _pass_on_interrupt(error)
    except Skip as reason:
        outcome, seen = Outcome.SKIPPED, str(reason)
        _pass_on_interrupt(reason)
    except Exception as error:  # noqa: BLE001 (whatever a strange vehicle breaks here, the rest has to run)
        outcome, seen = Outcome.FAILED, f"the check broke: {error!r}"
        _pass_on_interrupt(error)
    finally:
        peer.deadline_s = math.inf
        peer.quiet = False
    return Result(check, outcome, seen, peer.now - began_s)


def _pass_on_interrupt(error: BaseException) -> None:
    """Clean-up that fails after an interrupt must not hide it."""
    cause = error.__context__
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        cause = cause.__context__


def _settle(peer: Peer, check: Check) -> None:
    """On the ground and disarmed, or in the air and holding."""
    peer.fresh(BETWEEN_S)
    if check.category in FLIES:
        _mind_the_battery(peer)
    if check.airborne:
        flying.be_up(peer)
    elif peer.armed and ARM in peer.permits:
        flying.come_down(peer)
    elif peer.armed:
        raise Skip("the vehicle is armed; the suite may not land it")


def _enlarge_battery(peer: Peer) -> None:
    """The flights of a whole run take more than one charge, and nobody can swap a simulated battery."""
    peer.fresh()
    name = peer.dialect.battery_parameter
    if name is None or not has(peer, name):
        return
    before = read(peer, name)
    peer.debts[name] = lambda: put_back(peer, before)
    write(peer, name, max(before.value, RUN_MAH), before.type)


def _mind_the_battery(peer: Peer) -> None:
    """Land and `Skip` where the battery is low."""
    share = peer.request("SYS_STATUS").battery_remaining
    if 0 <= share < LOW_BATTERY:
        flying.come_down(peer)
        raise Skip(f"the battery is at {share} %")


def _alive(peer: Peer) -> bool:
    """Whether it still sends heartbeats; waits for one if need be."""
    if peer.now - peer.last["HEARTBEAT"].at_s < SILENCE_S:
        return True
    return _beats(peer, SILENCE_S)


def _beats(peer: Peer, within_s: float) -> bool:
    return peer.maybe("HEARTBEAT", is_autopilot, within_s=within_s) is not None


def _leave(peer: Peer, backup: Backup | None) -> list[str]:
    """Leave the vehicle as it was found; what did not work, in words."""
    if not _beats(peer, BACK_S):
        state = "armed" if peer.armed else "disarmed"
        changed = [*peer.debts, *(backup.names() if backup is not None else [])]
        return [
            f"nothing was heard of the vehicle for {BACK_S:g} s: last it was {state}; "
            f"not put back: {', '.join(changed) or 'nothing'}"
        ]
    if ARM in peer.permits:
        peer.wait(flying.HEARTBEAT_LAG_S)  # it may have been armed a moment ago
    notes = _bring_down(peer)
    if peer.armed:
        # What it flies by must not change under it.
        return [*notes, "its plans were not put back, because it is armed"] if backup is not None else notes
    if backup is not None:
        notes += backup.give_back()
    return notes + peer.pay()


def _bring_down(peer: Peer) -> list[str]:
    """On the ground and disarmed, over a link that may fail once more; what did not work, in words."""
    if peer.armed and ARM not in peer.permits:
        return ["the vehicle is armed, and the suite may not land it"]
    trouble = ""
    for _ in range(DOWN_ATTEMPTS):
        try:
            flying.come_down(peer)
        except (CheckFailed, Skip) as error:
            trouble = f"the vehicle could not be brought down: {error}"
        else:
            return []
        if not _beats(peer, BACK_S):
            break
    return [trouble]
