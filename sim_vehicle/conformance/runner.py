"""A run of checks on one vehicle: preparation, checks in order, restoration."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sim_vehicle.conformance import flying
from sim_vehicle.conformance.dialects import VehicleIdentity
from sim_vehicle.conformance.guard import ARM, PERMISSIONS, PLAN_NAMES, REBOOT, SIMULATOR
from sim_vehicle.conformance.outcomes import CheckFailed, Outcome, Skip
from sim_vehicle.conformance.parameters import has, read, restore, write
from sim_vehicle.conformance.plans import FENCE, RALLY, PlanBackup
from sim_vehicle.conformance.registry import Check
from sim_vehicle.conformance.traffic import is_autopilot
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.messages import MISSION

SILENCE_S = 5.0  # longest wait for a heartbeat after a check; without a heartbeat the check fails
HEARTBEAT_WAIT_S = 60.0  # longest wait for a heartbeat after a silence: a boot takes up to a minute
RESTORE_ATTEMPTS = 3  # this number of interrupts ends the restoration
LANDING_ATTEMPTS = 3
# Category that needs a backup of the plans -> types of the plans that must be in the backup.
WRITES_PLANS = {
    "modes": (MISSION,), "mission": (MISSION,), "fence": (FENCE,), "rally": (RALLY,), "robustness": (),
    "arming": (), "flight": (MISSION,), "mission-flight": (MISSION,), "reboot": (), "endurance": (),
}  # fmt: skip
FLIES = frozenset({"flight", "mission-flight"})
LOW_BATTERY_PERCENT = 20
RUN_CAPACITY_MAH = 30_000.0  # more than the flights of one run use
AS_STATED = "as stated"  # observation of a passed check that measures nothing
BOOTING_S = 5.0  # shortest time from a boot to the next check
PACE_S = 2.0  # shortest time for a measurement of the pace of the vehicle's clock
CHECK_S = 500.0  # time limit of a check; the longest one is the mission of a plane
PREPARATION_S = 400.0  # longest time for taking off or landing between checks


@dataclass(frozen=True, slots=True)
class CheckResult:
    check: Check
    outcome: Outcome
    seen: str  # the observation, or the reason for a failure or a skipped check
    took_s: float  # [s of vehicle time]


@dataclass(frozen=True, slots=True)
class RunReport:
    identity: VehicleIdentity
    results: tuple[CheckResult, ...]
    notes: tuple[str, ...]  # messages to the operator
    interrupted: bool = False

    def count(self, outcome: Outcome) -> int:
        return sum(result.outcome is outcome for result in self.results)

    @property
    def passed(self) -> bool:
        return self.count(Outcome.FAILED) == 0


def granted_permissions(
    identity: VehicleIdentity, allow: frozenset[str], *, ground_only: bool
) -> frozenset[str]:
    """Return all permissions for the simulator, else those of `allow`; `ground_only` removes ARM."""
    granted = PERMISSIONS if identity.simulator else allow - {SIMULATOR}
    return granted - {ARM} if ground_only else granted


def run(
    vehicle: VehicleUnderTest,
    checks: Sequence[Check],
    *,
    on_result: Callable[[CheckResult], None] = lambda _result: None,
    on_interrupt: Callable[[], None] = lambda: None,
) -> RunReport:
    """Run the checks on a connected vehicle.

    A vehicle that is armed at the start is in use: every check is skipped and nothing is restored. After any
    other run, also after an interrupt, the vehicle is landed and restored before the report.
    `RESTORE_ATTEMPTS` further interrupts end the restoration.
    """
    state = _RunState(vehicle, on_result)
    if vehicle.armed:
        state.stop_reason = "the vehicle was armed before the run; all checks were skipped [already-armed]"
        state.was_armed = True
    else:
        state.boots.let_boot()
    interrupted = False
    try:
        for check in checks:
            state.run_check(check)
    except KeyboardInterrupt:
        interrupted = True
        on_interrupt()
    except BaseException:
        # After a bug or a closed output the vehicle may still fly.
        state.restore_vehicle()
        raise
    notes = [
        f"the restoration was interrupted {RESTORE_ATTEMPTS} times: the vehicle may still fly or keep "
        "changes; land the vehicle, and check plans and parameters [not-restored]"
    ]
    for _ in range(RESTORE_ATTEMPTS):
        try:
            notes = state.restore_vehicle()
            break
        except KeyboardInterrupt:
            interrupted = True
            on_interrupt()
    return RunReport(vehicle.identity, tuple(state.results), tuple(notes), interrupted)


class _BootWatch:
    """Reboots between checks, and the pace of the vehicle's clock, by its time since boot."""

    def __init__(self, vehicle: VehicleUnderTest) -> None:
        self._vehicle = vehicle
        self._latest_s: float | None = None  # None if the vehicle did not answer
        self._pace_from: tuple[float, float] | None = None  # vehicle's time since boot, time of the wire [s]

    def let_boot(self) -> bool:
        """Wait until `BOOTING_S` after a boot; return True for a reboot since the previous call.

        ArduPilot undoes earlier mode changes.
        """
        before_s, self._latest_s = self._latest_s, None
        try:
            self._latest_s = float(self._vehicle.request("SYSTEM_TIME").time_boot_ms) / 1000
        except (CheckFailed, Skip):
            return False
        rebooted = before_s is not None and self._latest_s < before_s
        self._measure_pace(self._latest_s, rebooted=rebooted)
        self._vehicle.wait(max(0.0, BOOTING_S - self._latest_s))
        return rebooted

    def _measure_pace(self, boot_s: float, *, rebooted: bool) -> None:
        """Set the pace of the vehicle's clock since the previous measurement."""
        wire_s = self._vehicle.wire_s
        if self._pace_from is None or rebooted:
            self._pace_from = boot_s, wire_s
            return
        passed_s = wire_s - self._pace_from[1]
        if passed_s >= PACE_S:
            self._vehicle.set_pace((boot_s - self._pace_from[0]) / passed_s)
            self._pace_from = boot_s, wire_s


class _RunState:
    def __init__(self, vehicle: VehicleUnderTest, on_result: Callable[[CheckResult], None]) -> None:
        self._vehicle, self._on_result = vehicle, on_result
        self.boots = _BootWatch(vehicle)
        self._backup = PlanBackup(vehicle)
        self._battery_enlarged = False  # also True if the vehicle has no battery parameter
        self._reported: set[int] = set()  # types of unsaved plans that already failed a check
        self.results: list[CheckResult] = []
        self.stop_reason: str | None = None  # reason to skip the remaining checks
        self._restored: list[str] | None = None  # notes of the restoration before the dangerous checks
        self.was_armed = False  # before the run

    def run_check(self, check: Check) -> None:
        """Run one check, or record a skipped check with its reason."""
        reason = self.stop_reason if self.stop_reason is not None else _skip_reason(self._vehicle, check)
        result = (
            CheckResult(check, Outcome.SKIPPED, reason, 0.0) if reason is not None else self._result_of(check)
        )
        self.results.append(result)
        self._on_result(result)

    def _result_of(self, check: Check) -> CheckResult:
        if check.dangerous and self._restored is None:
            self._restored = self._restore()
        if check.category in WRITES_PLANS and not self._backup.is_taken:
            self._vehicle.begin_check()
            self._backup.save()
        unsaved = self._unsaved(check)
        if unsaved is not None:
            return unsaved
        if not self._battery_enlarged and check.category in FLIES and SIMULATOR in self._vehicle.permissions:
            self._battery_enlarged = True
            _enlarge_battery(self._vehicle)
        result = _run_function(self._vehicle, check)
        failure = self._failure_after(check)
        if failure is None:
            return result
        seen = f"the vehicle {failure}; result of the check: {result.seen}"
        return CheckResult(check, Outcome.FAILED, seen, result.took_s)

    def _failure_after(self, check: Check) -> str | None:
        """Wait until the vehicle is back; return a text about its silence or unasked reboot, or None."""
        quiet_s = self._vehicle.now - self._vehicle.heartbeat_s
        silent = quiet_s >= SILENCE_S and not _sends_heartbeats(self._vehicle, SILENCE_S)
        if silent and not _sends_heartbeats(self._vehicle, HEARTBEAT_WAIT_S):
            self.stop_reason = (
                f"the vehicle sent no heartbeat for {SILENCE_S + HEARTBEAT_WAIT_S:g} s after {check.name}; "
                "the remaining checks were skipped [vehicle-silent]"
            )
            return "sent no heartbeat after the check"
        if self.boots.let_boot() and REBOOT not in check.needs:
            return "rebooted during the check [rebooted]"
        return f"sent no heartbeat for {SILENCE_S:g} s after the check" if silent else None

    def _unsaved(self, check: Check) -> CheckResult | None:
        """Return the result of a check that could overwrite a plan without a copy, else None."""
        for kind in WRITES_PLANS.get(check.category, ()):
            if kind in self._backup.unsaved:
                # Only the first check of an unsaved plan fails; further checks are skipped.
                outcome = Outcome.SKIPPED if kind in self._reported else Outcome.FAILED
                self._reported.add(kind)
                why = f"{self._backup.unsaved[kind]} [plan-unsaved]"
                seen = f"not run: the {PLAN_NAMES[kind]} could not be saved: {why}"
                return CheckResult(check, outcome, seen, 0.0)
        return None

    def restore_vehicle(self) -> list[str]:
        """Restore the vehicle; return notes to the operator."""
        notes = [self.stop_reason] if self.stop_reason is not None else []
        if self.was_armed:
            return notes
        if self._restored is not None:  # the dangerous checks change nothing, and may have ended the vehicle
            return notes + self._restored
        return notes + self._restore()

    def _restore(self) -> list[str]:
        vehicle, backup = self._vehicle, self._backup
        vehicle.begin_check()
        notes = [
            f"the {PLAN_NAMES[kind]} could not be saved and was not overwritten: {why} [plan-unsaved]"
            for kind, why in backup.unsaved.items()
        ]
        if not _sends_heartbeats(vehicle, HEARTBEAT_WAIT_S):
            state = "armed" if vehicle.armed else "disarmed"
            changed = [*vehicle.pending_restores, *backup.names()]
            lost = (
                f"the vehicle sent no heartbeat for {HEARTBEAT_WAIT_S:g} s (last heartbeat: {state}); "
                f"these changes remain: {', '.join(changed) or 'none'} [vehicle-lost]"
            )
            return [*notes, lost]
        if ARM in vehicle.permissions:
            vehicle.wait(flying.HEARTBEAT_LAG_S)  # the heartbeat may not yet show a recent arming
        notes += _land(vehicle)
        if backup.is_taken and vehicle.armed:  # a plan in use must not change
            notes.append("the plans were not restored, because the vehicle is armed [not-restored]")
        else:
            notes += backup.restore()
        return notes + vehicle.restore_all()


def _skip_reason(vehicle: VehicleUnderTest, check: Check) -> str | None:
    """Return the reason for which a check does not apply or is not permitted, or None."""
    if check.dialects and vehicle.dialect.name not in check.dialects:
        return f"only for {', '.join(sorted(check.dialects))}"
    if check.kind is not None and vehicle.identity.kind != check.kind:
        return f"only for a {check.kind}"
    for capability in check.claims:
        if not vehicle.identity.claims(capability):
            return f"the vehicle does not claim {capability}"
    missing = check.needs - vehicle.permissions
    if SIMULATOR in missing:
        return "only for the simulator"
    if missing:
        options = " ".join(f"--allow-{name}" for name in sorted(missing))
        return f"not permitted: needs {options}{' without --ground-only' if ARM in missing else ''}"
    return None


def _run_function(vehicle: VehicleUnderTest, check: Check) -> CheckResult:
    began_s = vehicle.now
    try:
        _prepare(vehicle, check)
    except (CheckFailed, Skip) as error:
        outcome, text = _outcome_of(error)
        return CheckResult(check, outcome, f"could not start: {text}", vehicle.now - began_s)
    began_s = vehicle.now
    vehicle.begin_check(CHECK_S)
    try:
        outcome, seen = Outcome.PASSED, check.function(vehicle) or AS_STATED
    except Exception as error:  # noqa: BLE001 (an unexpected answer must not stop the run)
        outcome, seen = _outcome_of(error)
        _pass_on_interrupt(error)
    finally:
        vehicle.deadline_s = math.inf
        vehicle.heartbeats_off = False
    return CheckResult(check, outcome, seen, vehicle.now - began_s)


def _outcome_of(error: Exception) -> tuple[Outcome, str]:
    if isinstance(error, Skip):
        return Outcome.SKIPPED, str(error)
    return Outcome.FAILED, str(error) if isinstance(error, CheckFailed) else f"the check raised {error!r}"


def _pass_on_interrupt(error: BaseException) -> None:
    """Raise KeyboardInterrupt if an interrupt caused this error."""
    cause = error.__context__
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        cause = cause.__context__


def _prepare(vehicle: VehicleUnderTest, check: Check) -> None:
    """Bring the vehicle to the ground or into the air, as the check needs."""
    vehicle.begin_check(PREPARATION_S)
    if check.category in FLIES:
        _check_battery(vehicle)
    if check.airborne:
        flying.ensure_airborne(vehicle)
    elif vehicle.armed and ARM in vehicle.permissions:
        flying.ensure_landed(vehicle)
    elif vehicle.armed:
        raise Skip("the vehicle is armed, and landing needs --allow-arm")


def _enlarge_battery(vehicle: VehicleUnderTest) -> None:
    """Enlarge the simulated battery, because the flights of a run use more than one charge."""
    vehicle.begin_check()
    name = vehicle.dialect.battery_parameter
    if name is None or not has(vehicle, name):
        return
    before = read(vehicle, name)
    vehicle.pending_restores[name] = lambda: restore(vehicle, before)
    write(vehicle, name, max(before.value, RUN_CAPACITY_MAH), before.type)


def _check_battery(vehicle: VehicleUnderTest) -> None:
    """If the battery is low, land the vehicle and raise Skip."""
    percent = vehicle.request("SYS_STATUS").battery_remaining
    if 0 <= percent < LOW_BATTERY_PERCENT:
        flying.ensure_landed(vehicle)
        raise Skip(f"the battery is at {percent} % (limit {LOW_BATTERY_PERCENT} %) [battery-low]")


def _sends_heartbeats(vehicle: VehicleUnderTest, within_s: float) -> bool:
    return vehicle.wait_for("HEARTBEAT", is_autopilot, within_s=within_s) is not None


def _land(vehicle: VehicleUnderTest) -> list[str]:
    """Land and disarm in up to `LANDING_ATTEMPTS` attempts; return a text for the last failure."""
    if vehicle.armed and ARM not in vehicle.permissions:
        return [
            "the vehicle is armed, and landing needs --allow-arm; "
            "land the vehicle with another station [not-landed]"
        ]
    failure = ""
    for _ in range(LANDING_ATTEMPTS):
        try:
            flying.ensure_landed(vehicle)
        except (CheckFailed, Skip) as error:
            failure = f"the vehicle did not land: {error}; land the vehicle with another station [not-landed]"
        else:
            return []
        if not _sends_heartbeats(vehicle, HEARTBEAT_WAIT_S):
            break
    return [failure]
