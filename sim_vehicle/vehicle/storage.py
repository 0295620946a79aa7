"""Storage of one vehicle: flight logs and the files that ground stations read."""

import math
from typing import Any, NamedTuple

from sim_vehicle.epoch import EPOCH_US
from sim_vehicle.files.ftp import FtpServer
from sim_vehicle.files.log_transfer import LogTransfer
from sim_vehicle.files.logs.record import Failsafe, FlightLog, LogStart, LogWhen
from sim_vehicle.files.logs.recorder import FlightRecorder, LogLimits
from sim_vehicle.physics.geodesy import GeodeticPosition
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.mission import MissionState

SEND_INTERVAL_S = 0.1  # interval between calls of `tick` during a transfer
LOGGED_FAILSAFES = (
    Failsafe.RADIO,
    Failsafe.BATTERY,
    Failsafe.GROUND_STATION,
    Failsafe.FENCE,
    Failsafe.POSITION,
)


class _LoggedState(NamedTuple):
    """Vehicle state; the log records its changes."""

    armed: bool = False
    mode: int = -1
    airborne: bool = False
    origin: GeodeticPosition | None = None
    home: GeodeticPosition | None = None
    mission_item: int | None = None
    failed: tuple[bool, ...] = (False,) * len(LOGGED_FAILSAFES)


class Storage:
    """The logs and files of one vehicle; `limits` are the size limits of the logs."""

    def __init__(self, vehicle: Vehicle, limits: LogLimits) -> None:
        rules = vehicle.personality.storage
        self._vehicle = vehicle
        self.recorder = FlightRecorder(rules.new_log, limits)
        self._ftp = FtpServer(rules.files(vehicle, self.recorder), rules.ftp, send=vehicle.send)
        self._transfer = LogTransfer(
            lambda: self.recorder.logs,
            erase=self.recorder.erase,
            rules=rules.logs,
            send=vehicle.send,
            send_text=vehicle.send_text,
            armed=lambda: vehicle.armed,
        )
        self._logged = _LoggedState()
        self._disarmed_since_boot = False

    # -- serving -----------------------------------------------------------------------------------------

    def receive(self, message: Any, now: float) -> None:
        """Process one message about files or logs at `now` [s]."""
        if message.get_type() == "FILE_TRANSFER_PROTOCOL":
            self._ftp.receive(message, now)
        else:
            self._transfer.receive(message, now)

    def tick(self, now: float) -> None:
        """Send the part of a transfer that the link can carry by `now` [s]."""
        self._ftp.tick(now)
        self._transfer.tick(now)

    def next_s(self, now: float) -> float:
        """Return the time of the next `tick` with work [s]; inf: no transfer."""
        return now + SEND_INTERVAL_S if self._ftp.busy or self._transfer.busy else math.inf

    def reboot(self, now: float) -> None:
        """End the log and forget transfers; files and logs stay."""
        self.recorder.end(now)
        self._disarmed_since_boot = False
        self._ftp.reset()
        self._transfer.reset()

    # -- recording ---------------------------------------------------------------------------------------

    def record_changes(self, now: float) -> None:
        """Record changes of the vehicle's state; begin and end logs when required."""
        self._begin_if_required(now)
        if not self.recorder.recording:
            return
        state = _logged_state(self._vehicle)
        if state != self._logged:
            log = self.recorder.log_for_event(now)
            if log is not None:
                self._log_changes(log, now, state)
            self._disarmed_since_boot |= self._logged.armed and not state.armed
            self._logged = state
        if not self._recording_required():
            self.recorder.end(now)

    def _begin_if_required(self, now: float) -> None:
        if not self.recorder.recording and self._recording_required():
            self._begin(now)

    def _recording_required(self) -> bool:
        vehicle = self._vehicle
        when = vehicle.flight_parameters.logs
        if when is LogWhen.NEVER or not (vehicle.booted and self.recorder.enabled):
            return False
        from_boot = when is LogWhen.FROM_BOOT and not self._disarmed_since_boot
        return vehicle.armed or when is LogWhen.ALWAYS or from_boot

    def text(self, now: float, severity: int, text: str) -> None:
        """Record a STATUSTEXT; begin a log first if required."""
        self._begin_if_required(now)
        log = self.recorder.log_for_event(now)
        if log is not None:
            log.text(now, severity, text)

    def parameter(self, now: float, name: str) -> None:
        """Record a parameter change."""
        log = self.recorder.log_for_event(now)
        if log is not None:
            log.parameter(now, name, self._vehicle.params[name])

    def strike(self, now: float, vehicle_cell: tuple[int, int], hostile_cell: tuple[int, int]) -> None:
        """Record a hit by a hostile, with the cells (row, column) of vehicle and hostile."""
        log = self.recorder.log_for_event(now)
        if log is not None:
            log.strike(now, self._vehicle.strikes, vehicle_cell, hostile_cell)

    def _begin(self, now: float) -> None:
        vehicle, identity = self._vehicle, self._vehicle.personality.identity
        self.recorder.begin(
            now,
            LogStart(
                utc_s=EPOCH_US / 1e6 + now,
                boot_s=vehicle.readiness.boot_s,
                banner=identity.banner,
                flight_sw_version=identity.flight_sw_version,
                parameters=dict(vehicle.params.items()),
                defaults=vehicle.params.defaults,
                mode=vehicle.mode.number,
            ),
        )
        self._logged = _LoggedState(mode=vehicle.mode.number, airborne=vehicle.body.airborne)

    def _log_changes(self, log: FlightLog, now: float, state: _LoggedState) -> None:
        before, mission = self._logged, self._vehicle.mission
        if state.origin is not None and state.origin != before.origin:
            log.origin(now, *state.origin)
        if state.home is not None and state.home != before.home:
            log.home(now, *state.home)
        if state.armed != before.armed:
            log.armed(now, state.armed)
        if state.mode != before.mode:
            log.mode(now, state.mode)
        if state.airborne != before.airborne:
            log.landed(now, not state.airborne)
        for kind, is_active, was_active in zip(LOGGED_FAILSAFES, state.failed, before.failed, strict=True):
            if is_active != was_active:
                log.failsafe(now, kind, is_active)
        item = state.mission_item
        if item is not None and item != before.mission_item and item < mission.count:
            log.command(now, item, mission.count, mission.item(item))


def _logged_state(vehicle: Vehicle) -> _LoggedState:
    failsafes, mission = vehicle.failsafes, vehicle.mission
    return _LoggedState(
        vehicle.armed,
        vehicle.mode.number,
        vehicle.body.airborne,
        vehicle.home_and_rally.origin,
        vehicle.home_and_rally.home,
        mission.index if mission.state is MissionState.ACTIVE else None,
        (
            failsafes.rc_lost,
            failsafes.battery_level > 0,
            failsafes.gcs_lost,
            bool(vehicle.fence_watch.breached),
            failsafes.position_lost,
        ),
    )
