"""One vehicle without I/O: messages and time in, messages out.

A vehicle decides on three occasions: a message arrives, its body reports an event (such as target reached,
take-off, touchdown, position lost or found), or its own deadline is due (`alarm_s`). The vehicle writes its
state into its row of the fleet's `Status`. The fleet encodes the telemetry of all vehicles from `Status`.
"""

import math
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.faults.failure_command import Replace
from sim_vehicle.faults.sim_parameters import faults_of
from sim_vehicle.files.logs.recorder import LogLimits
from sim_vehicle.personalities.base import Personality
from sim_vehicle.physics.body import Body
from sim_vehicle.physics.geodesy import GeodeticPosition
from sim_vehicle.vehicle.arming import Arming
from sim_vehicle.vehicle.behaviour import Behaviour, Mode
from sim_vehicle.vehicle.command import sender_of
from sim_vehicle.vehicle.failsafe import Failsafes
from sim_vehicle.vehicle.fence import Fence
from sim_vehicle.vehicle.fence_watch import FenceWatch
from sim_vehicle.vehicle.flight import Flight
from sim_vehicle.vehicle.flight_parameters import FlightParameters
from sim_vehicle.vehicle.home_and_rally import HomeAndRally
from sim_vehicle.vehicle.injected_faults import InjectedFaults
from sim_vehicle.vehicle.jobs import Jobs
from sim_vehicle.vehicle.mission import MissionState
from sim_vehicle.vehicle.modes import Modes
from sim_vehicle.vehicle.params import Parameters
from sim_vehicle.vehicle.publish import publish
from sim_vehicle.vehicle.readiness import Readiness
from sim_vehicle.vehicle.sender import Sender
from sim_vehicle.vehicle.setpoints import Setpoints
from sim_vehicle.vehicle.storage import Storage
from sim_vehicle.wire.outbox import Outbox
from sim_vehicle.wire.signing import Signing
from sim_vehicle.wire.status import Status
from sim_vehicle.wire.streams import Rates, Streams

PREARM_TEXT_INTERVAL_S = 30.0
REBOOT_SILENCE_S = 1.5
PHASES = 5  # after a boot, the streams of a vehicle start at one of 5 moments within a second
IDLE_INTERVAL_S = 1.0  # longest time between two decisions of a vehicle
BUSY_INTERVAL_S = 0.1


class Autopilot:
    """The state of one vehicle, and its reaction to messages and to the passing of time.

    Parameters
    ----------
    index: index in the fleet's arrays.
    sysid: MAVLink system id.
    body: the vehicle's airframe in the world.
    personality: the simulated autopilot.
    parameters: changes to the personality's parameters.
    ready_s: time from boot to a position estimate [s].
    rng: the vehicle's own randomness.
    status: table of the state of all autopilots, one row per vehicle.
    streams: the fleet's message intervals.
    output: the fleet's encoder and link.
    injected_faults: the faults of this vehicle.
    replace_faults: function (key, faults, now) that ends the earlier faults of `key` and begins new faults.
    log_limits: size limits of the flight logs.
    """

    now: float
    failsafes: Failsafes

    def __init__(
        self,
        index: int,
        sysid: int,
        body: Body,
        personality: Personality,
        parameters: dict[str, float],
        *,
        ready_s: float,
        rng: np.random.Generator,
        status: Status,
        streams: Streams,
        output: Outbox,
        injected_faults: InjectedFaults,
        replace_faults: Replace,
        log_limits: LogLimits,
    ) -> None:
        self.injected_faults, self.replace_faults, self.signing = injected_faults, replace_faults, Signing()
        self.index, self.sysid, self.body, self.personality, self.rng = index, sysid, body, personality, rng
        self.status, self._output = status, output
        status.autopilot[index] = personality.identity.autopilot
        status.vehicle_type[index] = personality.identity.vehicle_type
        status.home_is_local[index] = personality.home.is_local
        telemetry = personality.telemetry
        self.rates = Rates(streams, index, telemetry.default_rates_hz, telemetry.unsupported)
        self.sender = Sender(self, output)
        self.send = self.sender.send
        self.send_text, self.announce = self.sender.send_text, self.sender.announce
        body.set_gps_fix(telemetry.gps_fix_type)
        self.params = Parameters(
            personality.parameters, {personality.parameters.system_id: sysid, **parameters}
        )
        self.flight_parameters: FlightParameters = personality.flight_parameters(self.params)
        self.fence, self.home_and_rally = Fence(), HomeAndRally(self)
        self.mission = personality.mission.make(self)
        self.modes, self.remote = Modes(self), personality.remote(self)
        self.flight = Flight(self)
        self.arming = Arming(self)
        self.transfer = personality.mission.transfer(self)
        self.jobs = Jobs(self.sender.acknowledge)
        self.setpoints = Setpoints(self)
        self.storage = Storage(self, log_limits)
        self._ready_s = ready_s
        self._next_idle_s = float(rng.random())
        # Few phases, so that the fleet encodes 1 Hz messages of many vehicles at a time.
        self._phase_s = math.floor(self._next_idle_s * PHASES) / PHASES
        self.now = self.alarm_s = self._update_due_s = self._boot_due_s = 0.0
        self.strikes = self.boots = 0
        self.reboot_after_reply = False
        self.booted = False
        self._reset(0.0)

    def _reset(self, now: float) -> None:
        """Reset the state that a reboot loses; parameters and the mission stay."""
        self.readiness = Readiness(now, self._ready_s)
        self.modes.reset(now)
        self.home_and_rally.reset()
        self.failsafes = Failsafes(self)
        self.fence_watch = FenceWatch(self)
        self._mode_switch_was_read = False
        self._next_prearm_s = now + PREARM_TEXT_INTERVAL_S
        self.transfer.reset()
        self.params.reboot()
        self.storage.reboot(now)
        self.signing.reboot()
        for part in (self.sender, self.jobs, self.setpoints, self.remote):
            part.reset()
        self.mission.reboot()
        self.flight.reboot(self.mode)

    # -- output -------------------------------------------------------------------------------------------

    def announce_refusals(self, event: str, now: float) -> None:
        """Send one STATUSTEXT for each reason against arming; `event` selects the personality's text."""
        for reason in self.personality.arming.refusals(self, now):
            self.announce(event, reason=reason)

    def send_now(self, message_id: int, now: float, parameter: float = 0.0) -> bool:
        """Send one message on request; return False if the message is unknown or has no data yet."""
        if self.rates.can_stream(message_id):
            publish(self, now)
            return self._output.stream_now(self.index, message_id, now)
        one_shot = self.personality.messages.one_shot.get(message_id)
        messages = () if one_shot is None else one_shot(self, parameter)
        for message in messages:
            self.send(message)
        return bool(messages)

    # -- input --------------------------------------------------------------------------------------------

    def receive(self, message: Any, now: float) -> None:
        """Process one message; ignore a message to another vehicle, and every message during a boot."""
        if not self.booted or (
            self.flight_parameters.gcs.only and message.get_srcSystem() != self.flight_parameters.gcs.sysid
        ):
            return
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self._receive_heartbeat(message, now)
            return
        foreign = getattr(message, "target_system", 0) not in (0, self.sysid)
        if foreign or not self.personality.commands.is_addressed(self.sysid, message):
            if self.personality.commands.refuses_foreign and kind in ("COMMAND_LONG", "COMMAND_INT"):
                self.sender.acknowledge(message.command, mavlink.MAV_RESULT_FAILED, 0, sender_of(message))
            return
        self.now = now
        handler = self.personality.messages.receivers.get(kind)
        if handler is None:
            return
        handler(self, message, now)
        self.storage.record_changes(now)
        self.alarm_s = self._update_due_s = now

    def _receive_heartbeat(self, heartbeat: Any, now: float) -> None:
        sysid = heartbeat.get_srcSystem()
        if heartbeat.type == mavlink.MAV_TYPE_GCS or sysid == self.flight_parameters.gcs.sysid:
            self.failsafes.receive_heartbeat(sysid, now)

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter as a ground station does; raise KeyError if the name is unknown."""
        self.params.set(name, value)
        self.parameter_changed(name)

    def parameter_changed(self, name: str) -> None:
        self.update_flight_parameters()
        self.update_parameter_faults(name)
        self.storage.parameter(self.now, name)

    def update_flight_parameters(self) -> None:
        """Derive the flight parameters again after a parameter change."""
        before = self.flight_parameters
        self.flight_parameters = self.personality.flight_parameters(self.params)
        self.flight.parameters_changed(before)
        self.fence_watch.parameters_changed()

    def update_parameter_faults(self, name: str) -> None:
        """Begin or end the faults that a simulation parameter (SIM_*) sets."""
        found = faults_of(name, self.params.__getitem__, self.body.lat_lon_deg[0])
        if found is not None:
            self.replace_faults(*found, self.now)

    # -- time ---------------------------------------------------------------------------------------------

    def decide(self, now: float, *, has_event: bool) -> None:
        """Update the vehicle if an update is due, else check only the fence; set `alarm_s`."""
        before = self.fence_watch.breached
        if has_event or before or not self.booted or self._update_due_s <= now + EPSILON_S:
            self.update(now)
            return
        self.now = now
        self.fence_watch.update(now)
        if self.fence_watch.breached:
            self.update(now)
        else:
            self._set_alarm(now)

    def update(self, now: float) -> None:
        """Boot if due, check readiness and failsafes, steer, continue transfers, and set `alarm_s`."""
        self.now = now
        if not self.booted:
            self.alarm_s = self._boot_due_s
            if now + EPSILON_S < self._boot_due_s:
                return
            self._boot(now)
        self._update_readiness(now)
        self.sender.send_delayed(now)
        failsafe_s = self.failsafes.update(now)
        self.flight.run(now)
        self.setpoints.expire(now)
        touchdown_m_s = self.body.take_touchdown_m_s()
        if touchdown_m_s > 0:
            self.announce("touchdown", speed=touchdown_m_s)
        if self.body.crashed and self.armed:
            self.arming.stop("crashed")
        self.fence_watch.update(now)
        disarm_s = self.arming.update(now)
        self.transfer.tick(now)
        self.params.tick(self.send, now)
        self.storage.tick(now)
        self.storage.record_changes(now)
        # Each vehicle keeps its own phase, so that vehicles booted together decide at different ticks.
        while self._next_idle_s <= now + EPSILON_S:
            self._next_idle_s += IDLE_INTERVAL_S
        self._update_due_s = min(
            self._next_idle_s,
            failsafe_s,
            disarm_s,
            self.flight.next_run_s(now),
            self.readiness.next_s(now),
            self.jobs.tick(now),
            self.setpoints.next_deadline_s,
            self.transfer.next_deadline_s,
            self.storage.next_s(now),
            self.sender.next_s,
            now + BUSY_INTERVAL_S if self.params.listing else math.inf,
        )
        self._set_alarm(now)
        publish(self, now)

    def _set_alarm(self, now: float) -> None:
        fence_s = now + BUSY_INTERVAL_S if self.fence_watch.active else math.inf
        self.alarm_s = min(self._update_due_s, fence_s)

    def reboot(self, now: float, silence_s: float = REBOOT_SILENCE_S) -> None:
        """Stop the motors and go silent for `silence_s` [s], then boot."""
        self.storage.reboot(now)
        self.booted = False
        self.status.booted[self.index] = False
        self._boot_due_s = self.alarm_s = now + silence_s
        if self.armed:
            self.body.arm(False)

    def _boot(self, now: float) -> None:
        self.boots += 1
        self.booted = True
        self._reset(now)
        for text in self.personality.identity.boot_text:
            self._output.raw(self.index, text)
        self.rates.boot(now, now + self._phase_s)

    def _update_readiness(self, now: float) -> None:
        if not self._mode_switch_was_read and self.readiness.mode_switch_read(now):
            self._mode_switch_was_read = True
            if self.readiness.ready_s > 0:
                self.modes.mode_switch_read()
        self.home_and_rally.update(now)
        if not self.armed and now >= self._next_prearm_s:
            self._next_prearm_s += PREARM_TEXT_INTERVAL_S
            self.announce_refusals("prearm", now)

    def record_strike(self, vehicle_cell: tuple[int, int], hostile_cell: tuple[int, int], now: float) -> None:
        """Count and report a hit by a hostile; cells are (row, column). The vehicle flies on."""
        self.now = now
        self.strikes += 1
        self.status.strikes[self.index] = self.strikes
        self.storage.strike(now, vehicle_cell, hostile_cell)
        over, hostile = (f"{row},{column}" for row, column in (vehicle_cell, hostile_cell))
        self.send_text(mavlink.MAV_SEVERITY_WARNING, f"STRIKE {self.strikes} over {over} from {hostile}")

    # -- position -----------------------------------------------------------------------------------------

    def position_known(self, now: float) -> bool:
        """Return True if the position estimate is good enough for navigation."""
        return self.readiness.position_ready(now) and self.body.position_ok

    def here(self) -> GeodeticPosition:
        return GeodeticPosition(*self.body.lat_lon_deg, self.body.alt_amsl_m)

    # -- arming and mode ----------------------------------------------------------------------------------

    @property
    def mode(self) -> Mode:
        return self.modes.mode

    @property
    def armed(self) -> bool:
        return self.body.armed

    @property
    def flies_mission(self) -> bool:
        return self.mode.behaviour is Behaviour.MISSION and self.mission.state is MissionState.ACTIVE
