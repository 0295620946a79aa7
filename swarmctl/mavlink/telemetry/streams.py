"""Telemetry streams: requested until they arrive, and again when they stop, for example after a reboot."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import command_long
from swarmctl.mavlink.protocol.conversation import MavlinkPeer

_REPEAT_PAUSE_S, _MAX_REPEAT_PAUSE_S = 3.0, 30.0
"""first and longest pause between requests for a missing stream"""
AFTER_FLIGHT_HZ = 1.0
"""highest rate after a flight: the radio then serves the vehicles that still fly"""
AFTER_SILENCE_S = 1.5
"""delay of new requests after a silence: if the vehicle has not rebooted, its streams continue"""

_POSITION = int(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
_STOPPED_US = -1.0
"""the interval of MAV_CMD_SET_MESSAGE_INTERVAL that ends a stream"""
_MAX_STREAM_INTERVAL_S = 3.0
"""longest interval between messages of one stream; after a longer interval a message is no stream"""
_STOP_SPACING_S = 0.2
"""pause between commands that end streams, because many commands at once would fill a slow link"""
_STOP_AGAIN_S, _STOP_AGAIN_LIMIT_S = 5.0, 120.0
"""first and longest pause before a stream is ended again: another station may have requested the stream"""


class Streaming(msgspec.Struct, frozen=True):
    """Settings of a vehicle's streams."""

    position_hz: float | None = None
    """Rate of positions; None: the dialect's rate. A lower rate slows all other streams in proportion."""
    stops_others: bool = False
    """True if this program ends the streams that it does not use"""

    def rates_hz(self, usual_hz: Mapping[int, float]) -> dict[int, float]:
        """Return the rates to request over this link (message id -> rate), from a dialect's rates."""
        if self.position_hz is None:
            return dict(usual_hz)
        share = min(self.position_hz / usual_hz[_POSITION], 1.0)
        return {msgid: hz * share for msgid, hz in usual_hz.items()} | {_POSITION: self.position_hz}


class StreamKeeper:
    """Keeper of the streams `rates_hz` (message id -> rate); `stops_others` ends the `UNUSED_IDS` streams.

    Only the arrival of a message confirms a request; acknowledgements are ignored. A message at less than
    half of its rate confirms nothing. The pauses between requests for a missing message grow, because some
    firmwares do not support that message.
    """

    def __init__(
        self, peer: MavlinkPeer, rates_hz: Mapping[int, float], *, stops_others: bool = False
    ) -> None:
        self._peer = peer
        self._flight_hz = self._rates_hz = rates_hz
        self._armed = False
        self._due: dict[int, float] = {}
        self._check_at: float | None = None
        """time of the next search for missing streams [s]"""
        self._repeat_s = dict.fromkeys(rates_hz, _REPEAT_PAUSE_S)
        self._stops_others = stops_others
        self._received_s: dict[int, float] = {}
        """last arrival of each message [s]"""
        self._stopped: dict[int, tuple[float, float]] = {}
        """time of the last command to end each stream, and pause before the next command [s]"""
        self._to_stop: deque[int] = deque()
        self._stop_at = 0.0

    @property
    def next_deadline(self) -> float | None:
        at = self._check_at
        return at if at is None or not self._to_stop else min(at, self._stop_at)

    def demand(self, due: float) -> None:
        """Schedule requests at time `due` for all streams that have not arrived by then."""
        for msgid in self._rates_hz:
            self._due[msgid] = due
            self._repeat_s[msgid] = _REPEAT_PAUSE_S
        self._check_at = due
        self._stopped.clear()

    def renew(self, due: float) -> None:
        """Schedule the requests as `demand` does, if the streams have been demanded before."""
        if self._check_at is not None:
            self.demand(due)

    def set_armed(self, armed: bool, now: float) -> list[Message]:
        """Return the requests for other rates: a vehicle that disarms after a flight needs fewer messages."""
        if armed is self._armed:
            return []
        self._armed, before = armed, self._rates_hz
        limit_hz = math.inf if armed else AFTER_FLIGHT_HZ
        self._rates_hz = {msgid: min(hz, limit_hz) for msgid, hz in self._flight_hz.items()}
        for msgid in self._due:
            if self._rates_hz[msgid] != before[msgid]:
                self._due[msgid], self._repeat_s[msgid] = now, _REPEAT_PAUSE_S
        return self.tick(now)

    def on_message(self, msgid: int, now: float) -> None:
        received_s, self._received_s[msgid] = self._received_s.get(msgid), now
        if msgid in self._due:
            if received_s is None or now - received_s <= 2.0 / self._rates_hz[msgid]:
                self._repeat_s[msgid] = _REPEAT_PAUSE_S
                self._due[msgid] = now + max(_REPEAT_PAUSE_S, 3.0 / self._rates_hz[msgid])
        elif self._stops_others and self._due and msgid in UNUSED_IDS:
            self._on_unused(msgid, received_s, now)

    def _on_unused(self, msgid: int, received_s: float | None, now: float) -> None:
        if received_s is None or now - received_s > _MAX_STREAM_INTERVAL_S or msgid in self._to_stop:
            return
        if msgid in self._stopped:
            stopped_s, again_s = self._stopped[msgid]
            if now - stopped_s < again_s:
                return
        self._to_stop.append(msgid)

    def tick(self, now: float) -> list[Message]:
        missing = [msgid for msgid, due in self._due.items() if now >= due]
        for msgid in missing:
            self._due[msgid] = now + max(self._repeat_s[msgid], 3.0 / self._rates_hz[msgid])
            self._repeat_s[msgid] = min(2 * self._repeat_s[msgid], _MAX_REPEAT_PAUSE_S)
        self._check_at = min(self._due.values(), default=None)
        requests = [self._set_interval(msgid, float(round(1e6 / self._rates_hz[msgid]))) for msgid in missing]
        return requests + self._stop(now)

    def _stop(self, now: float) -> list[Message]:
        if not self._to_stop or now < self._stop_at:
            return []
        self._stop_at = now + _STOP_SPACING_S
        msgid = self._to_stop.popleft()
        _, again_s = self._stopped.get(msgid, (now, _STOP_AGAIN_S / 2.0))
        self._stopped[msgid] = now, min(2.0 * again_s, _STOP_AGAIN_LIMIT_S)
        return [self._set_interval(msgid, _STOPPED_US)]

    def _set_interval(self, msgid: int, interval_us: float) -> Message:
        return command_long(self._peer, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (float(msgid), interval_us))


UNUSED_IDS = frozenset(
    getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
    for name in (
        "AHRS",
        "AHRS2",
        "ALTITUDE",
        "AOA_SSA",
        "ATTITUDE",
        "ATTITUDE_QUATERNION",
        "ATTITUDE_TARGET",
        "BATTERY_STATUS",
        "DISTANCE_SENSOR",
        "ESC_TELEMETRY_1_TO_4",
        "ESC_TELEMETRY_5_TO_8",
        "ESTIMATOR_STATUS",
        "GPS2_RAW",
        "GPS_GLOBAL_ORIGIN",
        "GPS_RAW_INT",
        "GPS_STATUS",
        "HIGHRES_IMU",
        "HWSTATUS",
        "LOCAL_POSITION_NED",
        "MCU_STATUS",
        "MEMINFO",
        "MOUNT_ORIENTATION",
        "NAV_CONTROLLER_OUTPUT",
        "OBSTACLE_DISTANCE",
        "ODOMETRY",
        "OPTICAL_FLOW",
        "PID_TUNING",
        "POSITION_TARGET_GLOBAL_INT",
        "POSITION_TARGET_LOCAL_NED",
        "POWER_STATUS",
        "RANGEFINDER",
        "RAW_IMU",
        "RC_CHANNELS",
        "RC_CHANNELS_RAW",
        "RPM",
        "SCALED_IMU",
        "SCALED_IMU2",
        "SCALED_IMU3",
        "SCALED_PRESSURE",
        "SCALED_PRESSURE2",
        "SCALED_PRESSURE3",
        "SENSOR_OFFSETS",
        "SERVO_OUTPUT_RAW",
        "SIMSTATE",
        "TERRAIN_REPORT",
        "VFR_HUD",
        "VIBRATION",
        "WIND",
        "WIND_COV",
    )
)
"""Ids of streams that this program does not use, mostly for a pilot's instruments. Preflight requests single
GPS_RAW_INT messages. Messages between components (trackers, remote identification) are not in the set."""
