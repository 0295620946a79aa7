"""A witness of firmware in flight. It listens on another link of each autopilot, and can act as a station."""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from namespaces import until
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.station.messages import PlanItem, command_long, set_mode
from swarmctl.core.geo import distance_m

OTHER_STATION = 250
POSITION_HZ = 5.0
ASK_AGAIN_S = 3.0
"""time without a position after which the witness asks for positions"""
IN_THE_AIR_M = 2.0
ANSWER_S = 10.0


@dataclass(frozen=True, slots=True)
class Fix:
    """A position that a vehicle reported."""

    at_s: float
    """the machine's clock, as in the record of the flight"""
    lat_deg: float
    lon_deg: float
    height_m: float
    """above home"""


def _decoder() -> Any:
    made = mavlink.MAVLink(None)
    made.robust_parsing = True
    return made


@dataclass
class Seen:
    """The witness's view of one vehicle."""

    address: tuple[str, int] = ("", 0)
    fixes: list[Fix] = field(default_factory=list)
    mode: int = -1
    """custom mode of the last heartbeat"""
    is_armed: bool = False
    armed_at_s: list[float] = field(default_factory=list)
    has_position: bool = False
    """the estimator has an absolute position"""
    mission_index: int = -1
    texts: list[str] = field(default_factory=list)
    messages: dict[str, Any] = field(default_factory=dict)
    """the last message of each type"""
    asked_at_s: float = -math.inf
    decoder: Any = field(default_factory=_decoder)

    @property
    def height_m(self) -> float:
        return self.fixes[-1].height_m if self.fixes else 0.0

    def stands(self, within_m: float) -> bool:
        """Return whether the vehicle has moved less in the last 3 s."""
        if not self.fixes:
            return False
        now = self.fixes[-1]
        recent = [fix for fix in self.fixes if fix.at_s > now.at_s - 3.0]
        return all(
            distance_m((fix.lat_deg, fix.lon_deg), (now.lat_deg, now.lon_deg)) < within_m for fix in recent
        )

    def flown(self) -> list[Fix]:
        """Return the positions in the air."""
        return [fix for fix in self.fixes if fix.height_m > IN_THE_AIR_M]


class Witness:
    """Receives in a thread of its own. Without its heartbeats no failsafe takes it for the ground station."""

    def __init__(self, bound: socket.socket) -> None:
        self._socket = bound
        self._socket.settimeout(0.1)
        self._codec = mavlink.MAVLink(None, srcSystem=OTHER_STATION, srcComponent=190)
        self._uploads: dict[int, Sequence[Any]] = {}
        self._is_closed = False
        self._seen: defaultdict[int, Seen] = defaultdict(Seen)
        self._thread = threading.Thread(target=self._run, name="witness", daemon=True)
        self._thread.start()

    def __getitem__(self, sysid: int) -> Seen:
        return self._seen[sysid]

    def close(self) -> None:
        self._is_closed = True
        self._thread.join()
        self._socket.close()

    def until(self, condition: Callable[[Witness], object], what: str, within_s: float) -> None:
        until(lambda: condition(self), lambda: f"{what}; seen: {self}", within_s)

    def __str__(self) -> str:
        return "; ".join(
            f"{sysid}: mode {seen.mode}, {'armed' if seen.is_armed else 'disarmed'}, {seen.height_m:.0f} m, "
            f"item {seen.mission_index}, texts {seen.texts[-6:]}"
            for sysid, seen in sorted(self._seen.items())
        )

    # -- another station --------------------------------------------------------------------------------

    def set_mode(self, sysid: int, custom_mode: int) -> None:
        """Select a mode as another station does, and wait until the vehicle reports the mode."""
        self._send(sysid, set_mode((sysid, 1), custom_mode))
        self.until(lambda w: w[sysid].mode == custom_mode, f"mode {custom_mode} of {sysid}", ANSWER_S)

    def set_parameter(self, sysid: int, name: str, value: float) -> None:
        """Set a parameter of an ArduPilot, and wait until the vehicle confirms the value."""
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        self._send(sysid, mavlink.MAVLink_param_set_message(sysid, 1, name.encode(), value, kind))

        def is_set(witness: Witness) -> bool:
            said = witness[sysid].messages.get("PARAM_VALUE")
            return said is not None and said.param_id == name and abs(said.param_value - value) < 1e-3

        self.until(is_set, f"{name} of {sysid}", ANSWER_S)

    def upload(self, sysid: int, items: Sequence[tuple[int, float, float, float]]) -> None:
        """Upload a mission of (command, latitude, longitude, height) as another station does."""
        self._uploads[sysid] = [
            PlanItem(command, round(lat * 1e7), round(lon * 1e7), height).message((sysid, 1), seq)
            for seq, (command, lat, lon, height) in enumerate(items)
        ]
        self._seen[sysid].messages.pop("MISSION_ACK", None)
        self._send(sysid, mavlink.MAVLink_mission_count_message(sysid, 1, len(items), 0))
        self.until(
            lambda w: getattr(w[sysid].messages.get("MISSION_ACK"), "type", None) == 0,
            f"mission of {sysid}",
            ANSWER_S,
        )

    # -- the thread --------------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._is_closed:
            try:
                data, address = self._socket.recvfrom(65_536)
            except TimeoutError:
                continue
            sysid = _sender(data)
            if sysid is None:
                continue
            seen = self._seen[sysid]
            if address != seen.address:
                seen.address, seen.decoder = address, _decoder()
            for message in seen.decoder.parse_buffer(data) or ():
                if message.get_srcSystem() == sysid and message.get_srcComponent() == 1:
                    self._receive(sysid, seen, message)
            self._ask(sysid, seen)

    def _receive(self, sysid: int, seen: Seen, message: Any) -> None:
        kind = message.get_type()
        seen.messages[kind] = message
        if kind == "HEARTBEAT":
            is_armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            if is_armed and not seen.is_armed:
                seen.armed_at_s.append(time.time())
            seen.mode, seen.is_armed = message.custom_mode, is_armed
        elif kind == "GLOBAL_POSITION_INT" and message.lat:
            height_m = message.relative_alt / 1e3
            seen.fixes.append(Fix(time.time(), message.lat / 1e7, message.lon / 1e7, height_m))
        elif kind == "EKF_STATUS_REPORT":
            seen.has_position = bool(message.flags & mavlink.EKF_POS_HORIZ_ABS)
        elif kind == "MISSION_CURRENT":
            seen.mission_index = message.seq
        elif kind == "STATUSTEXT":
            seen.texts.append(message.text)
        elif kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT") and sysid in self._uploads:
            self._send(sysid, self._uploads[sysid][message.seq])

    def _ask(self, sysid: int, seen: Seen) -> None:
        now_s = time.time()
        latest_s = max(seen.asked_at_s, seen.fixes[-1].at_s if seen.fixes else -math.inf)
        if now_s - latest_s < ASK_AGAIN_S:
            return
        seen.asked_at_s = now_s
        for number in (
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        ):
            interval_us = 1e6 / POSITION_HZ
            command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            self._send(sysid, command_long((sysid, 1), command, number, interval_us))

    def _send(self, sysid: int, message: Any) -> None:
        self._socket.sendto(message.pack(self._codec), self._seen[sysid].address)


def _sender(data: bytes) -> int | None:
    """Return the system id in the header of a datagram's first frame; None for other bytes."""
    if data[:1] == b"\xfd" and len(data) > 9:
        return int(struct.unpack_from("B", data, 5)[0])
    return data[3] if data[:1] == b"\xfe" and len(data) > 7 else None
