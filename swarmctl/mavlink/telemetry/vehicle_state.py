"""Telemetry of a vehicle: its messages combined into a `VehicleState`."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.vehicle import Landed, ModeRole, VehicleState
from swarmctl.mavlink.dialects import Dialect
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.telemetry.presence import is_armed
from swarmctl.mavlink.telemetry.readiness import Readiness
from swarmctl.mavlink.telemetry.statustext import TextAssembler, strike_count
from swarmctl.mavlink.telemetry.vehicle_clock import VehicleClock

STILL_M_S, STILL_CLIMB_M_S = 0.5, 0.3
"""a vehicle in the air below both speeds stands still"""
MAX_POSITION_AGE_S = 3.0
"""Age after which a position is dropped, by the local clock. ArduPilot reports the loss of its position; PX4
stops sending positions."""
MAX_POSITIONS, MIN_POSITIONS = 10, 3
"""largest and smallest number of positions for their mean interval"""
NEW_STATE_PERIOD_S = 0.9
"""shortest time between two new states that heartbeats or SYS_STATUS cause while no positions arrive"""
MIN_ALT_M, MAX_ALT_M = -1000.0, 20_000.0
"""limits of a valid altitude above sea level or home"""
TEXTS_KEPT = 256

_LANDED = {landed.value: landed for landed in Landed}
_PERIODIC_SOURCES = ("HEARTBEAT", "SYS_STATUS")


class Telemetry:
    """Telemetry of one vehicle.

    `receive` returns True for a new state: at each position, at each change of mode or arming, and about once
    a second while no positions arrive.

    clock: the vehicle's clock, which knows the age of the newest message
    texts: last TEXTS_KEPT STATUSTEXTs (severity, text); `n_texts` counts all of them
    stood_still_s: time in hold or without motion in the air, by the vehicle's clock
    """

    def __init__(self, dialect: Dialect) -> None:
        self.texts: deque[tuple[int, str]] = deque(maxlen=TEXTS_KEPT)
        self.n_texts = 0
        self.n_heartbeats = 0
        self.n_reboots = 0
        self.stood_still_s = 0.0
        self._dialect = dialect
        self._state = VehicleState(brakes_m_s2=dialect.brakes_m_s2, start_delay_s=dialect.start_delay_s)
        self._latest: dict[str, Any] = msgspec.structs.asdict(self._state)
        """newest value of each field of the state"""
        self._has_changed = False
        """True if `_state` lacks some of these values"""
        self._now = 0.0
        self.clock = VehicleClock()
        self._new_state_s = -math.inf
        self._positions_s: deque[float] = deque(maxlen=MAX_POSITIONS)
        """arrival times of the last positions"""
        self._assembler = TextAssembler()
        self._readiness = Readiness(dialect)
        self._had_gps = False
        self._roles: dict[str, ModeRole] = {
            dialect.land_mode: "land",  # overwritten below if the mission mode lands
            dialect.hold_mode: "hold",
            dialect.mission_mode: "mission",
            dialect.return_mode: "return",
        }
        if dialect.setpoint_mode is not None:
            self._roles.setdefault(dialect.setpoint_mode, "setpoints")
        self._handlers: dict[str, Callable[[Message], bool]] = {
            "HEARTBEAT": self._heartbeat,
            "GLOBAL_POSITION_INT": self._global_position,
            "SYS_STATUS": self._sys_status,
            "SYSTEM_TIME": self._system_time,
            "EKF_STATUS_REPORT": lambda _message: False,  # only readiness has its content
            "EXTENDED_SYS_STATE": self._extended_sys_state,
            "MISSION_CURRENT": self._mission_current,
            "HOME_POSITION": self._home_position,
            "STATUSTEXT": self._statustext,
            "NAMED_VALUE_INT": self._named_value_int,
            "TIMESYNC": self._timesync,
        }

    @property
    def state(self) -> VehicleState:
        if self._has_changed:
            self._state, self._has_changed = VehicleState(**self._latest), False
        return self._state

    def receive(self, message: Message, now: float) -> bool:
        """Update the state from a message; return True for a new state. `now`: local clock [s]."""
        kind = message.get_type()
        handler = self._handlers.get(kind)
        if handler is None:
            return False
        self._now, self._has_changed = now, True
        changes_readiness = self._readiness.receive(message)
        is_new_state = handler(message)
        if changes_readiness:
            reasons = self._readiness.reasons(self._latest["mode"])
            self._latest |= {"ready": not reasons, "not_ready": reasons}
        if not is_new_state and kind in _PERIODIC_SOURCES:
            is_new_state = now - self._new_state_s >= NEW_STATE_PERIOD_S
        if is_new_state:
            self._new_state_s = now
        return is_new_state

    def set_other_mission(self, is_stored: bool) -> None:
        """Set whether the vehicle stores another mission than the verified one."""
        self._latest["other_mission"], self._has_changed = is_stored, True

    @property
    def position_age_s(self) -> float:
        """Return the age of the position at the last message [s]; 0 without a position."""
        return self.clock.age_s(self._now, self.state.time_boot_s) if self.state.has_position else 0.0

    def position_every_s(self, now: float) -> float | None:
        """Return the mean interval of the last positions, `now` included [s]; None before MIN_POSITIONS."""
        times_s = self._positions_s
        return (now - times_s[0]) / len(times_s) if len(times_s) >= MIN_POSITIONS else None

    def texts_since(self, n_texts: int) -> list[tuple[int, str]]:
        """Return the kept texts that came after the first `n_texts`."""
        new = self.n_texts - n_texts
        return list(self.texts)[-new:] if new else []

    def _heartbeat(self, message: Message) -> bool:
        self.n_heartbeats += 1
        mode = self._dialect.mode_name(int(message.custom_mode))
        armed = is_armed(message)
        is_changed = (mode, armed) != (self._latest["mode"], self._latest["armed"])
        self._latest |= {"mode": mode, "mode_role": self._roles.get(mode, "other"), "armed": armed}
        self._latest["heartbeat_s"] = self._now
        self._forget_old_position()
        return is_changed

    def _forget_old_position(self) -> None:
        """Drop an old position, so that no sensing, planning or return uses it."""
        if self._position_is_old:
            self._latest |= _NO_POSITION

    @property
    def _position_is_old(self) -> bool:
        reported_s = self._latest["position_s"]
        return reported_s is None or self._now - reported_s > MAX_POSITION_AGE_S

    def _system_time(self, message: Message) -> bool:
        """Update the vehicle's clock while no positions arrive; positions also carry the clock."""
        time_boot_s = self._read_clock(message)
        if time_boot_s is not None and self._position_is_old and time_boot_s > self._latest["time_boot_s"]:
            self._latest["time_boot_s"] = time_boot_s
        return False

    def _global_position(self, message: Message) -> bool:
        time_boot_s = self._read_clock(message)
        if time_boot_s is None or time_boot_s < self._latest["time_boot_s"]:
            return False
        self._count_standing(time_boot_s)
        position = _position_fields(message)
        if position is not _NO_POSITION:
            self._latest["position_s"] = self._now
            self._positions_s.append(self._now)
        self._latest |= position
        self._latest |= {
            "time_boot_s": time_boot_s,
            "ground_speed_m_s": (message.vx**2 + message.vy**2) ** 0.5 / 100.0,
            "east_m_s": message.vy / 100.0,
            "north_m_s": message.vx / 100.0,
            "climb_m_s": -message.vz / 100.0,
            "heading_deg": message.hdg / 100.0 if message.hdg < 36_000 else None,
        }
        return True

    def _count_standing(self, time_boot_s: float) -> None:
        """Add the time since the last state to `stood_still_s` if the vehicle held or stood still in the air.

        Braking in hold mode also counts.
        """
        last = self._latest
        is_still = last["ground_speed_m_s"] < STILL_M_S and abs(last["climb_m_s"]) < STILL_CLIMB_M_S
        is_still = is_still or last["mode_role"] == "hold"
        if is_still and last["armed"] and last["landed"] is Landed.IN_AIR:
            self.stood_still_s += time_boot_s - last["time_boot_s"]

    def _read_clock(self, message: Message) -> float | None:
        """Return a message's time since boot [s]; None if it shows a reboot, which clears the state."""
        time_boot_s, has_rebooted = self.clock.read(message, self._now, self._latest["time_boot_s"])
        if not has_rebooted:
            self._latest["delay_s"] = round(self.clock.age_s(self._now, time_boot_s), 1)
            return time_boot_s
        # Heartbeats come without a request, so their fields stay; other fields are from before the reboot.
        kept = ("mode", "mode_role", "armed", "brakes_m_s2", "start_delay_s", "heartbeat_s")
        self._latest = msgspec.structs.asdict(VehicleState(time_boot_s=time_boot_s)) | {
            name: self._latest[name] for name in kept
        }
        self._readiness = Readiness(self._dialect)
        self._had_gps = False
        self.n_reboots += 1
        return None

    def _sys_status(self, message: Message) -> bool:
        percent, millivolts = int(message.battery_remaining), int(message.voltage_battery)
        self._latest |= {
            "gps_ok": self._gps_ok(
                message.onboard_control_sensors_present, message.onboard_control_sensors_health
            ),
            "battery_percent": percent if 0 <= percent <= 100 else None,
            "battery_v": None if millivolts == 0xFFFF else millivolts / 1000.0,
            "status_s": self._now,
        }
        self._forget_old_position()
        return False

    def _gps_ok(self, present: int, health: int) -> bool | None:
        """Return whether the GPS works; None if there is no receiver. A receiver that disappears has failed.

        PX4 reports the GPS as present only while the estimator uses the GPS, but always as healthy
        (estimatorCheck.cpp, SYS_STATUS.hpp). In ArduPilot the GPS is present while the receiver sends data.
        """
        if present & mavlink.MAV_SYS_STATUS_SENSOR_GPS:
            self._had_gps = True
            return bool(health & mavlink.MAV_SYS_STATUS_SENSOR_GPS)
        return False if self._had_gps else None

    def _extended_sys_state(self, message: Message) -> bool:
        self._latest["landed"] = _LANDED.get(message.landed_state, Landed.UNDEFINED)
        return False

    def _mission_current(self, message: Message) -> bool:
        seq, total = int(message.seq), int(message.total)
        self._latest |= {
            # After an upload without a marked item, PX4 reports -1 until its navigator's next cycle.
            "mission_seq": None if seq == 0xFFFF else seq,
            "mission_total": None if total == 0xFFFF else total,
        }
        return False

    def _home_position(self, message: Message) -> bool:
        if not _is_possible(message.latitude, message.longitude, message.altitude):
            return False
        self._latest |= {
            "home_lat_deg": message.latitude / 1e7,
            "home_lon_deg": message.longitude / 1e7,
            "home_alt_amsl_m": message.altitude / 1000.0,
        }
        return False

    def _timesync(self, message: Message) -> bool:
        self.clock.receive_answer(message, self._now)
        return False

    def _statustext(self, message: Message) -> bool:
        for severity, text in self._assembler.receive(message):
            self.texts.append((severity, text))
            self.n_texts += 1
            if severity <= mavlink.MAV_SEVERITY_WARNING:
                self._latest["status_text"] = text
            strikes = strike_count(text)
            if strikes is not None:
                self._raise_strikes(strikes)
            self._readiness.add_text(text)
        return False

    def _named_value_int(self, message: Message) -> bool:
        if message.name.rstrip("\0") == "strikes" and self._read_clock(message) is not None:
            self._raise_strikes(int(message.value))
        return False

    def _raise_strikes(self, count: int) -> None:
        # The highest running count is right, even if messages were lost or late.
        self._latest["strikes"] = max(self._latest["strikes"], count)


_NO_POSITION: Mapping[str, float | None] = MappingProxyType(
    dict.fromkeys(("lat_deg", "lon_deg", "alt_rel_m", "alt_amsl_m"))
)


def _position_fields(message: Message) -> Mapping[str, float | None]:
    """Return the position fields of a GLOBAL_POSITION_INT."""
    # Without a position estimate the fields are zeros.
    known = message.lat != 0 or message.lon != 0
    if not known or not _is_possible(message.lat, message.lon, message.alt, message.relative_alt):
        return _NO_POSITION
    return {
        "lat_deg": message.lat / 1e7,
        "lon_deg": message.lon / 1e7,
        "alt_rel_m": message.relative_alt / 1000.0,
        "alt_amsl_m": message.alt / 1000.0,
    }


def _is_possible(lat_e7: int, lon_e7: int, *heights_mm: int) -> bool:
    """Return whether latitude, longitude and heights are within their limits."""
    on_earth = abs(lat_e7) <= 900_000_000 and abs(lon_e7) <= 1_800_000_000
    return on_earth and all(MIN_ALT_M <= mm / 1000.0 <= MAX_ALT_M for mm in heights_mm)
