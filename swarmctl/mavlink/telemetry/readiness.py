"""Readiness of a vehicle to arm and to fly a mission, from its messages since its boot."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.dialects import Dialect
from swarmctl.mavlink.protocol.codec import Message

_COMPLAINTS = ("PreArm: ", "Arm: ", "Preflight Fail: ")
_COMPLAINTS_KEPT = 3
_SOURCES = ("HEARTBEAT", "SYS_STATUS", "EKF_STATUS_REPORT", "STATUSTEXT")


class Readiness:
    """Readiness of one vehicle; a reboot begins a new one."""

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = dialect
        self._prearm_ok: bool | None = None
        self._ekf_flags: int | None = None
        self._complaints: tuple[str, ...] = ()
        """last texts of the vehicle about failed pre-arm checks"""
        self._missing = set(dialect.streams_hz) - {mavlink.MAVLINK_MSG_ID_HOME_POSITION}
        """ids of the messages that have not arrived yet"""

    def receive(self, message: Message) -> bool:
        """Read a message; return whether `reasons` may differ after it."""
        kind, msgid = message.get_type(), message.get_msgId()
        was_missing = msgid in self._missing
        self._missing.discard(msgid)
        if kind == "SYS_STATUS":
            health = message.onboard_control_sensors_health
            self._prearm_ok = bool(health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
            if self._prearm_ok:
                self._complaints = ()
        elif kind == "EKF_STATUS_REPORT":
            self._ekf_flags = int(message.flags)
        return was_missing or kind in _SOURCES

    def add_text(self, text: str) -> None:
        """Read a text of the vehicle, joined from its chunks."""
        if text.startswith(_COMPLAINTS):
            kept = (*(c for c in self._complaints if c != text), text)
            self._complaints = kept[-_COMPLAINTS_KEPT:]

    def reasons(self, mode: str) -> tuple[str, ...]:
        """Return the reasons against arming and flying a mission from this mode now; empty if none."""
        reasons = []
        # The pre-arm bit is for the current mode, and manual modes have fewer checks: STABILIZE needs no
        # position.
        if mode not in (self._dialect.hold_mode, self._dialect.mission_mode):
            reasons.append(f"mode is {mode or 'unknown'}, not {self._dialect.hold_mode}")
        if self._prearm_ok is False:
            reasons.append("; ".join(self._complaints) or "pre-arm checks not passed [pre-arm]")
        # Only ArduPilot sends EKF_STATUS_REPORT.
        if self._ekf_flags is not None and not self._ekf_flags & mavlink.EKF_POS_HORIZ_ABS:
            reasons.append("no position estimate yet [no-position]")
        if self._missing:
            names = sorted(mavlink.mavlink_map[msgid].msgname for msgid in self._missing)
            reasons.append(f"no {', '.join(names)} received yet")
        return tuple(reasons)
