"""One vehicle without I/O: messages and time in, bytes out."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle import commands, telemetry
from sim_vehicle.flight import Flight, Place
from sim_vehicle.mission import Item, Mission, MissionState
from sim_vehicle.mission_transfer import MissionTransfer
from sim_vehicle.params import Parameters
from sim_vehicle.personalities.base import Behaviour, Mode, Personality
from sim_vehicle.readiness import Readiness
from sim_vehicle.telemetry import STRIKES_INTERVAL_S, Streams
from sim_vehicle.world import Body

HEARTBEAT_S = 1.0
TIMESYNC_S = 10.0
PREARM_TEXT_S = 30.0
REBOOT_SILENCE_S = 1.5
COMPONENT = mavlink.MAV_COMP_ID_AUTOPILOT1
POSITION_ONLY = 0x0007  # bits of a SET_POSITION_TARGET type mask that would ignore the position


class Autopilot:
    """The state of one vehicle, and what it does with a message or with the passing of time.

    Parameters
    ----------
    sysid: MAVLink system id.
    body: its airframe in the world.
    personality: which autopilot it behaves like.
    parameters: changes to the personality's parameters.
    ready_s: from boot to a position estimate [s].
    rng: the vehicle's own randomness.
    """

    def __init__(
        self,
        sysid: int,
        body: Body,
        personality: Personality,
        parameters: dict[str, float],
        *,
        ready_s: float,
        rng: np.random.Generator,
    ) -> None:
        self.sysid, self.body, self.personality, self.rng = sysid, body, personality, rng
        values = {**personality.parameters, "SYSID_THISMAV": sysid, **parameters}
        self.params = Parameters(values, read_only=personality.read_only_parameters)
        self.mission = Mission(home=self._home_item)
        self.transfer = MissionTransfer(
            self.mission,
            store_item=personality.store_item,
            max_items=personality.max_mission_items,
            send=self.send,
            say=self.say,
            changed=self._mission_changed,
            flying=lambda: (
                self.mode.behaviour is Behaviour.MISSION and self.mission.state is MissionState.ACTIVE
            ),
        )
        self.flight = Flight(
            body,
            self.params,
            self.mission,
            home=lambda: self.home or self.here(),
            say=self.say,
            send=self.send,
            disarm=self._disarm,
        )
        self._codec = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=COMPONENT)
        self._outbox: list[bytes] = []
        self._ready_s = ready_s
        self.strikes = 0
        self.boots = 0
        self.reboot_after_reply = False
        self._boot_due_s = 0.0
        self._booted = False
        self._phase_s = float(rng.random())
        self.home: Place | None = None
        self._forget(0.0)

    def _forget(self, now: float) -> None:
        """Everything that does not survive a reboot; parameters and the mission do."""
        self.readiness = Readiness(now, self._ready_s)
        self.mode: Mode = self.personality.modes[self.personality.boot_mode]
        self.streams = Streams()
        self.armed = False
        self._armed_at_s = now
        self.home, self._home_locked = None, False
        self.origin: Place | None = None
        self._switch_read = False
        self.failsafe = False
        self._gcs_heard_s: float | None = None
        self._next_heartbeat_s = now + self._phase_s * HEARTBEAT_S
        self._next_timesync_s = now + TIMESYNC_S
        self._next_prearm_s = now + PREARM_TEXT_S
        self._next_strikes_s = now
        self.transfer.reset()
        self.mission.reset()
        self.mission.state = MissionState.NOT_STARTED
        self.flight.armed = self.flight.cleared_for_takeoff = False
        self.flight.enter(self.mode)

    # -- out ---------------------------------------------------------------------------------------------

    def send(self, message: Any) -> None:
        """Pack a message into the outbox."""
        self._outbox.append(bytes(message.pack(self._codec)))

    def say(self, severity: int, text: str) -> None:
        """STATUSTEXT."""
        self.send(mavlink.MAVLink_statustext_message(severity, text.encode()[:50]))

    def drain(self) -> list[bytes]:
        """Frames (and boot text) since the last call, in order."""
        frames, self._outbox = self._outbox, []
        return frames

    def send_built(self, message_id: int, now: float) -> bool:
        """Send one telemetry message now; False if it is unknown or has nothing to say yet."""
        builder = telemetry.BUILDERS.get(message_id)
        message = builder(self, now) if builder is not None else None
        if message is not None:
            self.send(message)
        return message is not None

    def set_message_interval(self, message_id: int, interval_s: float, now: float) -> None:
        self.streams.set_interval(message_id, interval_s, now)

    # -- in ----------------------------------------------------------------------------------------------

    def receive(self, message: Any, now: float) -> None:
        """Take one message that is for this vehicle or for all; replies are in the outbox."""
        if not self._booted:
            return
        kind = message.get_type()
        if self.transfer.handles(kind):
            self.transfer.receive(message, now)
        elif kind in RECEIVERS:
            RECEIVERS[kind](self, message, now)

    def _on_command(self, message: Any, now: float) -> None:
        command = commands.Command.from_message(message)
        result = commands.execute(self, command, now)
        self.send(
            mavlink.MAVLink_command_ack_message(
                command.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
            )
        )
        if self.reboot_after_reply:
            self.reboot_after_reply = False
            self._booted = False
            self._boot_due_s = now + REBOOT_SILENCE_S

    def _on_set_mode(self, message: Any, now: float) -> None:
        if message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            self.set_mode(message.custom_mode, now)

    def _on_parameter(self, message: Any, _now: float) -> None:
        if self.params.receive(message, self.send):
            self.flight.apply_limits()

    def _on_data_stream(self, message: Any, now: float) -> None:
        rate_hz = message.req_message_rate if message.start_stop else 0
        wanted = message.req_stream_id
        for stream, message_ids in self.personality.streams.items():
            if wanted in (mavlink.MAV_DATA_STREAM_ALL, stream):
                for message_id in message_ids:
                    self.set_message_interval(message_id, 1.0 / rate_hz if rate_hz else 0.0, now)

    def _on_timesync(self, message: Any, now: float) -> None:
        if message.tc1 == 0:
            clock_ns = round((now - self.readiness.boot_s) * 1e9)
            self.send(mavlink.MAVLink_timesync_message(clock_ns, message.ts1))

    def _on_heartbeat(self, message: Any, now: float) -> None:
        if message.get_srcSystem() == self.params["SYSID_MYGCS"]:
            self._gcs_heard_s = now

    def _on_set_current(self, message: Any, now: float) -> None:
        if self.set_current(message.seq):
            self.send_built(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, now)

    def _on_position_target(self, message: Any, _now: float) -> None:
        """SET_POSITION_TARGET_GLOBAL_INT: positions in GUIDED; velocities are ignored."""
        frame = message.coordinate_frame
        if self.mode.behaviour is not Behaviour.GUIDED or message.type_mask & POSITION_ONLY:
            return
        lat_deg, lon_deg = message.lat_int * 1e-7, message.lon_int * 1e-7
        if frame not in commands.FRAMES_WITH_ALTITUDE or abs(lat_deg) > 90 or abs(lon_deg) > 180:
            return
        if abs(message.alt) < 1e5:  # also false for NaN
            self.flight.guided_go(lat_deg, lon_deg, self.flight.altitude_amsl_m(frame, message.alt))

    # -- time --------------------------------------------------------------------------------------------

    def update(self, now: float) -> None:
        """Decide, some ten times a second: boot, readiness, mode, landing, failsafe, transfers."""
        if not self._booted:
            if now + 1e-9 < self._boot_due_s:
                return
            self._boot(now)
        self._note_readiness(now)
        self._watch_ground_station(now)
        self.flight.run(now)
        touchdown_m_s = self.body.take_touchdown_m_s()
        if touchdown_m_s > 0:
            self.say(mavlink.MAV_SEVERITY_WARNING, f"SIM Hit ground at {touchdown_m_s:.2f} m/s")
        delay_s = self.params["DISARM_DELAY"]
        idle_since_s = max(self._armed_at_s, self.flight.ground_since_s)
        if self.armed and delay_s > 0 and self.flight.landed(now) and now - idle_since_s >= delay_s:
            self._disarm()
        self.transfer.tick(now)

    def stream(self, now: float) -> None:
        """Send what is due by `now` [s]."""
        if not self._booted:
            return
        if now + 1e-9 >= self._next_heartbeat_s:
            self._next_heartbeat_s += HEARTBEAT_S
            self.send_built(mavlink.MAVLINK_MSG_ID_HEARTBEAT, now)
        if now + 1e-9 >= self._next_timesync_s:
            self._next_timesync_s += TIMESYNC_S
            self.send(mavlink.MAVLink_timesync_message(0, round((now - self.readiness.boot_s) * 1e9)))
        for message_id in self.streams.due(now):
            self.send_built(message_id, now)
        if now + 1e-9 >= self._next_strikes_s:
            self._next_strikes_s = now + STRIKES_INTERVAL_S
            if self.streams.wanted:
                self.send(telemetry.strikes(self, now))

    def _boot(self, now: float) -> None:
        self.boots += 1
        self._booted = True
        self._forget(now)
        self._outbox.extend(self.personality.boot_text)

    def _note_readiness(self, now: float) -> None:
        if not self._switch_read and self.readiness.mode_switch_read(now):
            self._switch_read = True
            if (
                self.mode.number != self.personality.boot_mode
                and not self.armed
                and self.readiness.ready_s > 0
            ):
                self._enter(self.personality.modes[self.personality.boot_mode])
        if self.origin is None and self.readiness.home(now):
            self.origin = self.here()
            self.say(mavlink.MAV_SEVERITY_INFO, "EKF3 IMU0 origin set")
            self.send_built(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, now)
            self.set_home(self.origin, now)
        if not self.armed and now >= self._next_prearm_s:
            self._next_prearm_s += PREARM_TEXT_S
            for reason in self.arming_refusals(now):
                self.say(mavlink.MAV_SEVERITY_CRITICAL, f"PreArm: {reason}")

    def _watch_ground_station(self, now: float) -> None:
        action = self.params["FS_GCS_ENABLE"]
        late = (
            action != 0
            and self._gcs_heard_s is not None
            and now - self._gcs_heard_s > self.params["FS_GCS_TIMEOUT"]
        )
        if late and not self.failsafe and self.armed:
            self.say(mavlink.MAV_SEVERITY_WARNING, "GCS Failsafe")
            if self.body.airborne:
                self.set_behaviour(Behaviour.LAND if action == 5 else Behaviour.RETURN, now)
            self.failsafe = True
        elif self.failsafe and not late:
            self.say(mavlink.MAV_SEVERITY_WARNING, "GCS Failsafe Cleared")
            self.failsafe = False

    def struck(self, over: tuple[int, int], by: tuple[int, int]) -> None:
        """A hostile hit the vehicle; it flies on."""
        self.strikes += 1
        text = f"STRIKE {self.strikes} over {over[0]},{over[1]} from {by[0]},{by[1]}"
        self.say(mavlink.MAV_SEVERITY_WARNING, text)

    # -- home --------------------------------------------------------------------------------------------

    def here(self) -> Place:
        return Place(*self.body.lat_lon_deg, self.body.alt_amsl_m)

    @property
    def height_above_home_m(self) -> float:
        return self.body.alt_amsl_m - (self.home.alt_amsl_m if self.home else self.body.ground_amsl_m)

    def set_home(self, place: Place, now: float, *, locked: bool = False) -> None:
        self.home, self._home_locked = place, self._home_locked or locked
        self.send_built(mavlink.MAVLINK_MSG_ID_HOME_POSITION, now)

    def _home_item(self) -> Item:
        home = self.home or Place(0.0, 0.0, 0.0)
        return Item(
            mavlink.MAV_CMD_NAV_WAYPOINT,
            x=round(home.lat_deg * 1e7),
            y=round(home.lon_deg * 1e7),
            z=round(home.alt_amsl_m, 2),
        )

    # -- arming and modes --------------------------------------------------------------------------------

    def arming_refusals(self, now: float) -> list[str]:
        """Why the vehicle would not arm now, apart from the mode being armable at all."""
        if self.mode.needs_position and not self.readiness.position(now):
            return ["Need Position Estimate"]
        if self.params["ARMING_CHECK"] != 0 and not self.readiness.home(now):
            return ["AHRS: waiting for home"]
        return []

    def arm(self, now: float, *, force: bool) -> bool:
        """Start the motors; the reasons of a refusal go out as texts."""
        if self.armed:
            return True
        reasons = [] if force else self.arming_refusals(now)
        in_auto = self.mode.behaviour is Behaviour.MISSION and int(self.params["AUTO_OPTIONS"]) & 1
        if not (self.mode.armable or in_auto or force):
            reasons.append(f"{self.mode.name} mode not armable")
        if reasons:
            for reason in reasons:
                self.say(mavlink.MAV_SEVERITY_CRITICAL, f"Arm: {reason}")
            return False
        if self.readiness.home(now) and not self._home_locked:
            self.set_home(self.here(), now)
        self.armed, self._armed_at_s = True, now
        self.flight.armed = True
        if in_auto and int(self.params["AUTO_OPTIONS"]) & 2:
            self.flight.cleared_for_takeoff = True
        self.body.arm(True)
        self.say(mavlink.MAV_SEVERITY_INFO, "Arming motors")
        return True

    def disarm(self, *, force: bool) -> bool:
        """Stop the motors on demand: in the air only if forced, and then the vehicle falls."""
        if self.body.airborne and self.armed and not force:
            return False
        if self.armed:
            self._disarm()
        return True

    def _disarm(self) -> None:
        self.armed = self.flight.armed = self.flight.cleared_for_takeoff = False
        self.body.arm(False)
        self.mission.reset()
        self.say(mavlink.MAV_SEVERITY_INFO, "Disarming motors")

    def set_behaviour(self, behaviour: Behaviour, now: float) -> bool:
        """Change to the personality's mode of this behaviour."""
        mode = next(mode for mode in self.personality.modes.values() if mode.behaviour is behaviour)
        return self.set_mode(mode.number, now)

    def set_mode(self, number: int, now: float) -> bool:
        """Change mode by its wire number, if it may be entered now."""
        mode = self.personality.modes.get(number)
        if mode is None:
            self.say(mavlink.MAV_SEVERITY_WARNING, f"No such mode {number}")
            return False
        if mode is self.mode:
            return True
        if self.armed and mode.needs_position and not self.readiness.position(now):
            self.say(mavlink.MAV_SEVERITY_WARNING, f"Mode change to {mode.name} failed: requires position")
            return False
        if mode.behaviour is Behaviour.MISSION and self.armed and not self._mission_may_start():
            return False
        self._enter(mode)
        return True

    def _enter(self, mode: Mode) -> None:
        self.mode = mode
        self.flight.enter(mode)

    def _mission_may_start(self) -> bool:
        if self.mission.count < 2:
            return False
        if not self.body.airborne and not self.mission.starts_with_takeoff():
            self.say(mavlink.MAV_SEVERITY_CRITICAL, "Auto: Missing Takeoff Cmd")
            return False
        return True

    # -- mission -----------------------------------------------------------------------------------------

    def start_mission_if_stopped(self) -> None:
        if self.mission.state is not MissionState.ACTIVE:
            self.mission.start_or_resume(self.flight)

    def set_current(self, index: int) -> bool:
        return self.mission.set_current(self.flight, index)

    def _mission_changed(self, index: int) -> None:
        """An item became another one (or the list was cut, -1) while the mission may be flown."""
        flown = self.mode.behaviour is Behaviour.MISSION and self.mission.state is MissionState.ACTIVE
        if not flown or index == 0 or (index == -1 and self.mission.index < self.mission.count):
            return
        if self.mission.restart_current(self.flight):
            self.say(mavlink.MAV_SEVERITY_CRITICAL, "Auto mission changed, restarted command")
        else:
            self.say(mavlink.MAV_SEVERITY_CRITICAL, "Auto mission changed but failed to restart command")


RECEIVERS: dict[str, Callable[[Autopilot, Any, float], None]] = {
    "COMMAND_LONG": Autopilot._on_command,
    "COMMAND_INT": Autopilot._on_command,
    "SET_MODE": Autopilot._on_set_mode,
    "PARAM_REQUEST_LIST": Autopilot._on_parameter,
    "PARAM_REQUEST_READ": Autopilot._on_parameter,
    "PARAM_SET": Autopilot._on_parameter,
    "REQUEST_DATA_STREAM": Autopilot._on_data_stream,
    "TIMESYNC": Autopilot._on_timesync,
    "HEARTBEAT": Autopilot._on_heartbeat,
    "MISSION_SET_CURRENT": Autopilot._on_set_current,
    "SET_POSITION_TARGET_GLOBAL_INT": Autopilot._on_position_target,
}
