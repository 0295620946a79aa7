"""Folds a vehicle's messages into its `VehicleState`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.vehicle import Landed, ModeRole, VehicleState
from swarmctl.mavlink.codec import Message
from swarmctl.mavlink.dialects import Dialect, Readiness
from swarmctl.mavlink.statustext import TextAssembler, strike_count

STILL_M_S, STILL_CLIMB_M_S = 0.5, 0.3
"""a vehicle in the air that moves less stands still"""
REBOOT_S = 3.0
"""a clock that goes back further than this was restarted; less is a datagram overtaken by another"""

_COMPLAINTS = ("PreArm: ", "Arm: ", "Preflight Fail: ")
_COMPLAINTS_KEPT = 3
_READINESS_SOURCES = ("HEARTBEAT", "SYS_STATUS", "EKF_STATUS_REPORT", "STATUSTEXT")


class Telemetry:
    """What one vehicle has told since it booted.

    `receive` returns whether a new position snapshot is complete. The rest is read from the attributes:
    `texts` counts all STATUSTEXTs (severity, text), `heartbeats` all heartbeats, `reboots` how often the
    vehicle's clock went back, `stood_still_s` how long it has held or stood still in the air by its own
    clock.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.texts: list[tuple[int, str]] = []
        self.heartbeats = 0
        self.reboots = 0
        self.stood_still_s = 0.0
        self._dialect = dialect
        self._state = VehicleState()
        self._changes: dict[str, Any] = {}
        self._assembler = TextAssembler()
        self._prearm_ok: bool | None = None
        self._ekf_flags: int | None = None
        self._complaints: tuple[str, ...] = ()
        self._missing = set(dialect.required)
        self._roles: dict[str, ModeRole] = {
            dialect.hold_mode: "hold",
            dialect.mission_mode: "mission",
            dialect.return_mode: "return",
            dialect.land_mode: "land",
        }
        self._fold: dict[str, Callable[[Message], bool]] = {
            "HEARTBEAT": self._heartbeat,
            "GLOBAL_POSITION_INT": self._global_position,
            "SYS_STATUS": self._sys_status,
            "EKF_STATUS_REPORT": self._ekf_status,
            "EXTENDED_SYS_STATE": self._extended_sys_state,
            "MISSION_CURRENT": self._mission_current,
            "HOME_POSITION": self._home_position,
            "STATUSTEXT": self._statustext,
            "NAMED_VALUE_INT": self._named_value_int,
        }

    @property
    def state(self) -> VehicleState:
        if self._changes:
            self._state = dataclasses.replace(self._state, **self._changes)
            self._changes = {}
        return self._state

    def receive(self, message: Message) -> bool:
        fold = self._fold.get(message.get_type())
        if fold is None:
            return False
        was_missing = message.get_msgId() in self._missing
        self._missing.discard(message.get_msgId())
        snapshot = fold(message)
        if was_missing or message.get_type() in _READINESS_SOURCES:
            self._judge_readiness()
        return snapshot

    def _heartbeat(self, message: Message) -> bool:
        self.heartbeats += 1
        mode = self._dialect.mode_name(int(message.custom_mode))
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        news = mode != self.state.mode or armed != self.state.armed
        self._changes |= {"mode": mode, "mode_role": self._roles.get(mode, "other"), "armed": armed}
        return news

    def _global_position(self, message: Message) -> bool:
        time_boot_s = message.time_boot_ms / 1000.0
        if self._notice_reboot(time_boot_s) or time_boot_s < self.state.time_boot_s:
            return False
        self._count_standing(time_boot_s)
        # Without a position estimate the fields are sent, as zeros.
        known = message.lat != 0 or message.lon != 0
        self._changes |= {
            "time_boot_s": time_boot_s,
            "lat_deg": message.lat / 1e7 if known else None,
            "lon_deg": message.lon / 1e7 if known else None,
            "alt_rel_m": message.relative_alt / 1000.0 if known else None,
            "alt_amsl_m": message.alt / 1000.0 if known else None,
            "ground_speed_m_s": (message.vx**2 + message.vy**2) ** 0.5 / 100.0,
            "east_m_s": message.vy / 100.0,
            "north_m_s": message.vx / 100.0,
            "climb_m_s": -message.vz / 100.0,
            "heading_deg": None if message.hdg == 0xFFFF else message.hdg / 100.0,
        }
        return True

    def _count_standing(self, time_boot_s: float) -> None:
        """Until `time_boot_s` it did what it told last; what brakes to hold counts as well."""
        last = self.state
        still = last.ground_speed_m_s < STILL_M_S and abs(last.climb_m_s) < STILL_CLIMB_M_S
        still = still or last.mode_role == "hold"
        if still and last.armed and last.landed is Landed.IN_AIR:
            self.stood_still_s += time_boot_s - last.time_boot_s

    def _notice_reboot(self, time_boot_s: float) -> bool:
        if time_boot_s >= self.state.time_boot_s - REBOOT_S:
            return False
        # Keep what is said by heartbeats, which come unasked; the rest is of a life before.
        last = self.state
        self._state = VehicleState(
            time_boot_s=time_boot_s, mode=last.mode, mode_role=last.mode_role, armed=last.armed
        )
        self._changes = {}
        self._prearm_ok = self._ekf_flags = None
        self._complaints = ()
        self._missing = set(self._dialect.required)
        self.reboots += 1
        return True

    def _sys_status(self, message: Message) -> bool:
        health = int(message.onboard_control_sensors_health)
        self._prearm_ok = bool(health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
        if self._prearm_ok:
            self._complaints = ()
        has_gps = int(message.onboard_control_sensors_present) & mavlink.MAV_SYS_STATUS_SENSOR_GPS
        self._changes["gps_ok"] = bool(health & mavlink.MAV_SYS_STATUS_SENSOR_GPS) if has_gps else None
        percent, millivolts = int(message.battery_remaining), int(message.voltage_battery)
        self._changes |= {
            "battery_percent": None if percent < 0 else percent,
            "battery_v": None if millivolts == 0xFFFF else millivolts / 1000.0,
        }
        return False

    def _ekf_status(self, message: Message) -> bool:
        self._ekf_flags = int(message.flags)
        return False

    def _extended_sys_state(self, message: Message) -> bool:
        known = message.landed_state in list(Landed)
        self._changes["landed"] = Landed(message.landed_state) if known else Landed.UNDEFINED
        return False

    def _mission_current(self, message: Message) -> bool:
        total = int(message.total)
        self._changes |= {
            "mission_seq": int(message.seq),
            "mission_total": None if total == 0xFFFF else total,
        }
        return False

    def _home_position(self, message: Message) -> bool:
        self._changes |= {
            "home_lat_deg": message.latitude / 1e7,
            "home_lon_deg": message.longitude / 1e7,
            "home_alt_amsl_m": message.altitude / 1000.0,
        }
        return False

    def _statustext(self, message: Message) -> bool:
        for severity, text in self._assembler.receive(message):
            self.texts.append((severity, text))
            if severity <= mavlink.MAV_SEVERITY_WARNING:
                self._changes["status_text"] = text
            strikes = strike_count(text)
            if strikes is not None:
                self._raise_strikes(strikes)
            if text.startswith(_COMPLAINTS):
                kept = (*(c for c in self._complaints if c != text), text)
                self._complaints = kept[-_COMPLAINTS_KEPT:]
        return False

    def _named_value_int(self, message: Message) -> bool:
        if message.name.rstrip("\0") == "strikes" and not self._notice_reboot(message.time_boot_ms / 1000.0):
            self._raise_strikes(int(message.value))
        return False

    def _raise_strikes(self, count: int) -> None:
        # A running count: the greatest one heard is right, whatever was lost or came late.
        self._changes["strikes"] = max(self.state.strikes, count)

    def _judge_readiness(self) -> None:
        mode = self._changes.get("mode", self._state.mode)
        readiness = Readiness(mode, self._prearm_ok, self._ekf_flags, self._complaints)
        reasons = self._dialect.not_ready(readiness)
        if self._missing:
            names = sorted(mavlink.mavlink_map[msgid].msgname for msgid in self._missing)
            reasons = (*reasons, f"no {', '.join(names)} heard yet")
        self._changes |= {"ready": not reasons, "not_ready": reasons}
