"""Runs checks on one vehicle, in order, and brings it into the state each of them begins in."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from sim_vehicle.conformance import flying
from sim_vehicle.conformance.facts import Facts
from sim_vehicle.conformance.parameters import Value, has, read, write
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.plans import Backup
from sim_vehicle.conformance.registry import ARM, SIMULATOR, Check, CheckFailed, Skip

SILENCE_S = 5.0  # without a heartbeat after a check: it harmed the vehicle
WRITES_PLANS = frozenset(
    {"mission", "fence", "rally", "robustness", "arming", "flight", "mission-flight", "reboot"}
)
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
) -> Report:
    """Run the checks on the vehicle that `peer` has met.

    A vehicle that is armed already is somebody else's: nothing is done to it. When the operator interrupts,
    it is brought down and its plans are put back before the report.
    """
    running = _Run(peer, on_result)
    interrupted = False
    if peer.armed:
        running.over = "the vehicle was armed before the suite began"
    else:
        _let_boot(peer)
    try:
        for check in checks:
            running.take(check)
    except KeyboardInterrupt:
        interrupted = True
    notes = running.leave()
    return Report(peer.facts, tuple(running.results), tuple(notes), interrupted)


class _Run:
    """What is known while the checks run."""

    def __init__(self, peer: Peer, on_result: Callable[[Result], None]) -> None:
        self._peer, self._on_result = peer, on_result
        self._backup: Backup | None = None
        self._battery: Value | None = None  # the simulator's, before it was made larger
        self.results: list[Result] = []
        self.over: str | None = None  # why nothing more can be checked

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
        if self._battery is None and check.category in FLIES and SIMULATOR in self._peer.permits:
            self._battery = _enlarge_battery(self._peer)
        result = _one(self._peer, check)
        if not _alive(self._peer):
            self.over = f"the vehicle fell silent after {check.name}"
            return Result(check, Outcome.FAILED, f"{result.seen}; then no heartbeat", result.took_s)
        return result

    def leave(self) -> list[str]:
        """Leave the vehicle as it was found; what the operator should know, in words."""
        if self.over is not None:
            return [self.over]
        notes = _leave(self._peer, self._backup)
        if self._battery is not None:
            notes += _shrink_battery(self._peer, self._battery)
        return notes


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
        return Result(check, Outcome.PASSED, check.function(peer), peer.now - began_s)
    except CheckFailed as error:
        return Result(check, Outcome.FAILED, str(error), peer.now - began_s)
    except Skip as reason:
        return Result(check, Outcome.SKIPPED, str(reason), peer.now - began_s)
    except Exception as error:  # noqa: BLE001 (whatever a strange vehicle breaks here, the rest has to run)
        return Result(check, Outcome.FAILED, f"the check broke: {error!r}", peer.now - began_s)
    finally:
        peer.deadline_s = math.inf
        peer.quiet = False


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


def _enlarge_battery(peer: Peer) -> Value | None:
    """The flights of a whole run take more than one charge, and nobody can swap a simulated battery."""
    peer.fresh()
    name = peer.dialect.battery_parameter
    if name is None or not has(peer, name):
        return None
    before = read(peer, name)
    write(peer, name, max(before.value, RUN_MAH), before.type)
    return before


def _shrink_battery(peer: Peer, before: Value) -> list[str]:
    try:
        write(peer, before.name, before.value, before.type)
    except (CheckFailed, Skip) as error:
        return [f"{before.name} could not be set back to {before.value:g}: {error}"]
    return []


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
    return peer.maybe("HEARTBEAT", within_s=SILENCE_S) is not None


def _leave(peer: Peer, backup: Backup | None) -> list[str]:
    """Leave the vehicle as it was found; what did not work, in words."""
    notes: list[str] = []
    peer.fresh()
    try:
        if peer.armed and ARM in peer.permits:
            flying.come_down(peer)
    except (CheckFailed, Skip) as error:
        notes.append(f"the vehicle could not be brought down: {error}")
    return notes + (backup.give_back() if backup is not None else [])
