"""PX4's ULog format (.ulg): self-describing topics, parameters and texts, readable by PX4's log tools.

Topics have only the simulated fields. Names are PX4's, except `strike` and `mission_result.item_command`.
"""

import math
import struct
from collections.abc import Mapping
from typing import Any

from sim_vehicle.files.logs.record import Failsafe, LogStart, Sample
from sim_vehicle.physics.attitude import quaternion
from sim_vehicle.vehicle.mission import Item

MAGIC = b"ULog\x01\x12\x35\x01"
_HEAD = struct.Struct("<HB")  # size of the rest, type of message
_ARMED, _DISARMED = 2, 1  # vehicle_status.arming_state

_TYPES = {"uint64_t": "Q", "int32_t": "i", "uint32_t": "I", "uint16_t": "H", "int16_t": "h", "uint8_t": "B",
          "float": "f", "double": "d", "bool": "?", "float[4]": "4f"}  # fmt: skip

_TOPICS: Mapping[str, str] = {
    "vehicle_attitude": "uint64_t timestamp;uint64_t timestamp_sample;float[4] q",
    "vehicle_local_position": (
        "uint64_t timestamp;uint64_t timestamp_sample;double ref_lat;double ref_lon;float x;float y;float z;"
        "float vx;float vy;float vz;float heading;float ref_alt;bool xy_valid;bool z_valid;bool v_xy_valid;"
        "bool v_z_valid"
    ),
    "vehicle_global_position": (
        "uint64_t timestamp;uint64_t timestamp_sample;double lat;double lon;float alt;float terrain_alt;"
        "bool terrain_alt_valid"
    ),
    "vehicle_gps_position": (
        "uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;double longitude_deg;"
        "double altitude_msl_m;float hdop;float vel_m_s;float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;"
        "float cog_rad;uint8_t fix_type;uint8_t satellites_used;bool vel_ned_valid"
    ),
    "battery_status": (
        "uint64_t timestamp;float voltage_v;float current_a;float discharged_mah;float remaining;"
        "bool connected"
    ),
    "vehicle_status": (
        "uint64_t timestamp;uint64_t armed_time;uint8_t arming_state;uint8_t nav_state;bool failsafe"
    ),
    "vehicle_land_detected": "uint64_t timestamp;bool landed",
    "home_position": (
        "uint64_t timestamp;double lat;double lon;float alt;bool valid_alt;bool valid_hpos;"
        "uint32_t update_count"
    ),
    "mission_result": (
        "uint64_t timestamp;uint16_t seq_current;uint16_t seq_total;uint16_t item_command;bool valid"
    ),
    "strike": "uint64_t timestamp;uint16_t count;int16_t row;int16_t col;int16_t by_row;int16_t by_col",
}
_TOPIC_IDS = {name: number for number, name in enumerate(_TOPICS)}
_SAMPLE_TOPICS = tuple(_TOPICS)[:5]

# custom_mode (main mode, sub mode) -> vehicle_status.nav_state
_NAV_STATES: Mapping[tuple[int, int], int] = {
    (1, 0): 0, (2, 0): 1, (3, 0): 2, (3, 1): 21, (4, 2): 17, (4, 3): 4, (4, 4): 3, (4, 5): 5, (4, 6): 18,
    (4, 8): 19, (4, 9): 20, (4, 10): 22, (5, 0): 10, (6, 0): 14, (7, 0): 15, (10, 0): 13,
}  # fmt: skip


def _body(name: str) -> str:
    kinds = (field.split(" ")[0] for field in _TOPICS[name].split(";"))
    return "HBH" + "".join(_TYPES[kind] for kind in kinds)


_STRUCTS = {name: struct.Struct("<" + _body(name)) for name in _TOPICS}
_SIZES = {name: form.size - _HEAD.size for name, form in _STRUCTS.items()}
_SAMPLE = struct.Struct("<" + "".join(_body(name) for name in _SAMPLE_TOPICS))
_ATTITUDE, _LOCAL, _GLOBAL, _GPS, _BATTERY = (_SIZES[name] for name in _SAMPLE_TOPICS)
_D = ord("D")  # message type of logged data


def _message(kind: str, body: bytes) -> bytes:
    return _HEAD.pack(len(body), ord(kind)) + body


def _keyed(kind: str, key: str, value: bytes) -> bytes:
    return _message(kind, bytes([len(key)]) + key.encode() + value)


_FORMATS = _message("B", bytes(40)) + b"".join(
    _message("F", f"{name}:{fields};".encode()) for name, fields in _TOPICS.items()
)
_SUBSCRIPTIONS = b"".join(
    _message("A", struct.pack("<BH", 0, number) + name.encode()) for name, number in _TOPIC_IDS.items()
)


class UlogLog:
    """A ULog file, with times since boot [us]."""

    def __init__(self) -> None:
        self.content = bytearray()
        self._boot_s = 0.0
        self._utc_of_boot_s = 0.0
        self._origin_deg_m = (math.nan, math.nan, math.nan)
        self._armed_us = 0
        self._home_updates = 0
        self._arming_state = _DISARMED
        self._nav_state = 0
        self._failsafes: set[Failsafe] = set()

    def _us(self, now: float) -> int:
        return max(round((now - self._boot_s) * 1e6), 0)

    def _add(self, topic: str, now: float, *values: Any) -> None:
        self.content += _STRUCTS[topic].pack(_SIZES[topic], _D, _TOPIC_IDS[topic], self._us(now), *values)

    def begin(self, now: float, start: LogStart) -> None:
        self._boot_s = start.boot_s
        self._utc_of_boot_s = start.utc_s - (now - start.boot_s)
        self.content += MAGIC + struct.pack("<Q", self._us(now)) + _FORMATS
        for key, text in (
            ("sys_name", "PX4"),
            ("ver_hw", "PX4_SITL"),
            ("ver_sw", start.banner[0] if start.banner else ""),
        ):
            self.content += _keyed("I", f"char[{len(text.encode())}] {key}", text.encode())
        version = start.flight_sw_version & 0xFFFFFFFF
        self.content += _keyed("I", "uint32_t ver_sw_release", struct.pack("<I", version))
        self.content += _keyed("I", "int32_t time_ref_utc", struct.pack("<i", 0))
        for name, value in start.parameters.items():
            self.parameter(now, name, value)
        self.content += _SUBSCRIPTIONS
        self.mode(now, start.mode)

    def sample(self, now: float, sample: Sample) -> None:
        us = self._us(now)
        utc_us = round((self._utc_of_boot_s + now - self._boot_s) * 1e6)
        ref_lat_deg, ref_lon_deg, ref_alt_m = self._origin_deg_m
        north_m_s, east_m_s, down_m_s = sample.north_m_s, sample.east_m_s, sample.down_m_s
        self.content += _SAMPLE.pack(
            _ATTITUDE, _D, 0, us, us, *quaternion(sample.roll_rad, sample.pitch_rad, sample.yaw_rad),
            _LOCAL, _D, 1, us, us, ref_lat_deg, ref_lon_deg, sample.north_m, sample.east_m, -sample.up_m,
            north_m_s, east_m_s, down_m_s, sample.yaw_rad, ref_alt_m, True, True, True, True,
            _GLOBAL, _D, 2, us, us, sample.lat_deg, sample.lon_deg, sample.alt_amsl_m, 0.0, False,
            _GPS, _D, 3, us, utc_us, sample.gps_lat_deg, sample.gps_lon_deg, sample.gps_alt_amsl_m,
            sample.gps_hdop, math.hypot(north_m_s, east_m_s), north_m_s, east_m_s, down_m_s,
            math.atan2(east_m_s, north_m_s), sample.gps_fix, sample.gps_satellites, sample.gps_fix >= 3,
            _BATTERY, _D, 4, us, sample.voltage_v, sample.current_a, sample.used_mah, sample.remaining, True,
        )  # fmt: skip

    def text(self, now: float, severity: int, text: str) -> None:
        body = struct.pack("<BQ", ord("0") + min(max(severity, 0), 7), self._us(now)) + text.encode()[:127]
        self.content += _message("L", body)

    def mode(self, now: float, number: int) -> None:
        main, sub = number >> 16 & 0xFF, number >> 24 & 0xFF
        self._nav_state = _NAV_STATES.get((main, sub), _NAV_STATES.get((main, 0), 0))
        self._add_status(now)

    def origin(self, now: float, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        self._origin_deg_m = lat_deg, lon_deg, alt_amsl_m

    def home(self, now: float, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        self._home_updates += 1
        self._add("home_position", now, lat_deg, lon_deg, alt_amsl_m, True, True, self._home_updates)

    def armed(self, now: float, armed: bool) -> None:
        self._arming_state = _ARMED if armed else _DISARMED
        self._armed_us = self._us(now) if armed else 0
        self._add_status(now)

    def _add_status(self, now: float) -> None:
        failsafe = bool(self._failsafes)
        self._add("vehicle_status", now, self._armed_us, self._arming_state, self._nav_state, failsafe)

    def landed(self, now: float, landed: bool) -> None:
        self._add("vehicle_land_detected", now, landed)

    def failsafe(self, now: float, kind: Failsafe, active: bool) -> None:
        (self._failsafes.add if active else self._failsafes.discard)(kind)
        self._add_status(now)

    def command(self, now: float, index: int, total: int, item: Item) -> None:
        self._add("mission_result", now, index, total, item.command, True)

    def parameter(self, now: float, name: str, value: float) -> None:
        if isinstance(value, int):
            self.content += _keyed("P", f"int32_t {name}", struct.pack("<i", value))
        else:
            self.content += _keyed("P", f"float {name}", struct.pack("<f", value))

    def strike(self, now: float, count: int, over: tuple[int, int], by: tuple[int, int]) -> None:
        self._add("strike", now, count, *over, *by)
