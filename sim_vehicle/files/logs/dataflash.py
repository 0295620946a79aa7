"""ArduPilot's DataFlash format (.BIN): self-describing messages, readable by ArduPilot's log tools."""

import math
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

from sim_vehicle.files.logs.record import Failsafe, LogStart, Sample
from sim_vehicle.vehicle.mission import Item

HEAD = b"\xa3\x95"
GPS_EPOCH_UTC_S = 315_964_800
LEAP_SECONDS = 18  # lead of GPS time over UTC [s]
WEEK_S = 604_800

EVENT_ARMED, EVENT_DISARMED, EVENT_LANDED, EVENT_NOT_LANDED = 10, 11, 18, 28
MODE_REASON_UNKNOWN = 0
ORIGIN, HOME = 0, 1  # ORGN.Type

_CODES = {  # DataFlash format code -> struct format code
    "B": "B", "b": "b", "M": "B", "h": "h", "H": "H", "i": "i", "I": "I", "q": "q", "Q": "Q", "f": "f",
    "d": "d", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "n": "4s", "N": "16s", "Z": "64s",
}  # fmt: skip


class _Format(NamedTuple):
    number: int
    codes: str
    columns: str
    units: str
    multipliers: str


_FORMATS: Mapping[str, _Format] = {
    "FMT": _Format(128, "BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"),
    "UNIT": _Format(129, "QbZ", "TimeUS,Id,Label", "s--", "F--"),
    "MULT": _Format(130, "Qbd", "TimeUS,Id,Mult", "s--", "F--"),
    "FMTU": _Format(131, "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
    "PARM": _Format(132, "QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
    "MSG": _Format(133, "QZ", "TimeUS,Message", "s-", "F-"),
    "MODE": _Format(134, "QMBB", "TimeUS,Mode,ModeNum,Rsn", "s---", "F---"),
    "ATT": _Format(
        135, "QffffffB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF", "sddddhh-", "F000000-"
    ),
    "POS": _Format(136, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt", "sDUmmm", "FGG000"),
    "GPS": _Format(
        137,
        "QBBIHBcLLeffffB",
        "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
        "s#-s-S-DUmnhnh-",
        "F--C-0BGGB000--",
    ),
    "BAT": _Format(
        138,
        "QBfffffcfBBB",
        "TimeUS,Inst,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res,RemPct,H,SH",
        "s#vvAaXOw%-%",
        "F-000C0?0000",
    ),
    "CMD": _Format(
        139,
        "QHHHffffLLfB",
        "TimeUS,CTot,CNum,CId,Prm1,Prm2,Prm3,Prm4,Lat,Lng,Alt,Frame",
        "s-------DUm-",
        "F-------GG0-",
    ),
    "EV": _Format(140, "QB", "TimeUS,Id", "s-", "F-"),
    "ERR": _Format(141, "QBB", "TimeUS,Subsys,ECode", "s--", "F--"),
    "ORGN": _Format(142, "QBLLe", "TimeUS,Type,Lat,Lng,Alt", "s-DUm", "F-GGB"),
    "STRK": _Format(143, "QHhhhh", "TimeUS,Count,Row,Col,ByRow,ByCol", "s-----", "F-----"),
}
_UNITS = {
    "-": "", "?": "UNKNOWN", "#": "instance", "%": "%", "A": "A", "D": "deglatitude", "O": "degC",
    "S": "satellites", "U": "deglongitude", "X": "W.h", "a": "Ah", "b": "B", "d": "deg", "h": "degheading",
    "m": "m", "n": "m/s", "s": "s", "v": "V", "w": "Ohm",
}  # fmt: skip
_MULTIPLIERS = {"-": 0.0, "?": 1.0, "0": 1.0, "B": 1e-2, "C": 1e-3, "F": 1e-6, "G": 1e-7}


def _body(name: str) -> str:
    return "3s" + "".join(_CODES[code] for code in _FORMATS[name].codes)


_STRUCTS = {name: struct.Struct("<" + _body(name)) for name in _FORMATS}
_HEADS = {name: HEAD + bytes([form.number]) for name, form in _FORMATS.items()}
_SAMPLE = struct.Struct("<" + "".join(_body(name) for name in ("ATT", "POS", "GPS", "BAT")))
_ATT, _POS, _GPS, _BAT = (_HEADS[name] for name in ("ATT", "POS", "GPS", "BAT"))
_MAX_I32 = 2**31 - 1


def _definitions() -> bytes:
    """Return the messages for formats, units and multipliers, equal in every log."""
    messages = bytearray()

    def add(name: str, *values: Any) -> None:
        messages.extend(_STRUCTS[name].pack(_HEADS[name], *values))

    for name, form in _FORMATS.items():
        size = _STRUCTS[name].size
        add("FMT", form.number, size, name.encode(), form.codes.encode(), form.columns.encode())
    for unit, label in _UNITS.items():
        add("UNIT", 0, ord(unit), label.encode())
    for code, factor in _MULTIPLIERS.items():
        add("MULT", 0, ord(code), factor)
    for form in _FORMATS.values():
        add("FMTU", 0, form.number, form.units.encode(), form.multipliers.encode())
    return bytes(messages)


_DEFINITIONS = _definitions()


class DataFlashLog:
    """A DataFlash log, with times since boot [us]."""

    def __init__(self) -> None:
        self.content = bytearray()
        self._boot_s = 0.0
        self._utc_of_boot_s = 0.0
        self._defaults: Mapping[str, float | int] = {}

    def _add(self, name: str, *values: Any) -> None:
        self.content += _STRUCTS[name].pack(_HEADS[name], *values)

    def _us(self, now: float) -> int:
        return max(round((now - self._boot_s) * 1e6), 0)

    def begin(self, now: float, start: LogStart) -> None:
        self._boot_s, self._defaults = start.boot_s, start.defaults
        self._utc_of_boot_s = start.utc_s - (now - start.boot_s)
        self.content += _DEFINITIONS
        for text in start.banner:
            self.text(now, 6, text)
        for name, value in start.parameters.items():
            self.parameter(now, name, value)
        self.mode(now, start.mode)

    def sample(self, now: float, sample: Sample) -> None:
        us = self._us(now)
        gps_s = max(self._utc_of_boot_s + (now - self._boot_s) - GPS_EPOCH_UTC_S + LEAP_SECONDS, 0.0)
        week = int(gps_s // WEEK_S)
        roll_deg, pitch_deg = math.degrees(sample.roll_rad), math.degrees(sample.pitch_rad)
        yaw_deg = math.degrees(sample.yaw_rad) % 360.0
        speed_m_s = math.hypot(sample.north_m_s, sample.east_m_s)
        course_deg = math.degrees(math.atan2(sample.east_m_s, sample.north_m_s)) % 360.0
        self.content += _SAMPLE.pack(
            _ATT, us, roll_deg, roll_deg, pitch_deg, pitch_deg, yaw_deg, yaw_deg, 3,
            _POS, us, _e7(sample.lat_deg), _e7(sample.lon_deg), sample.alt_amsl_m, sample.above_home_m,
            sample.up_m,
            _GPS, us, 0, sample.gps_fix, int((gps_s - week * WEEK_S) * 1000), week, sample.gps_satellites,
            min(round(sample.gps_hdop * 100), 9999), _e7(sample.gps_lat_deg), _e7(sample.gps_lon_deg),
            _cm(sample.gps_alt_amsl_m), speed_m_s, course_deg, sample.down_m_s, 0.0, 1,
            _BAT, us, 0, sample.voltage_v, sample.voltage_v, sample.current_a, sample.used_mah,
            sample.used_wh, 0, 0.0, round(sample.remaining * 100), 1, 0,
        )  # fmt: skip

    def text(self, now: float, severity: int, text: str) -> None:
        self._add("MSG", self._us(now), text.encode()[:64])

    def mode(self, now: float, number: int) -> None:
        self._add("MODE", self._us(now), number & 0xFF, number & 0xFF, MODE_REASON_UNKNOWN)

    def origin(self, now: float, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        self._add("ORGN", self._us(now), ORIGIN, _e7(lat_deg), _e7(lon_deg), _cm(alt_amsl_m))

    def home(self, now: float, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        self._add("ORGN", self._us(now), HOME, _e7(lat_deg), _e7(lon_deg), _cm(alt_amsl_m))

    def armed(self, now: float, armed: bool) -> None:
        self._add("EV", self._us(now), EVENT_ARMED if armed else EVENT_DISARMED)

    def landed(self, now: float, landed: bool) -> None:
        self._add("EV", self._us(now), EVENT_LANDED if landed else EVENT_NOT_LANDED)

    def failsafe(self, now: float, kind: Failsafe, active: bool) -> None:
        self._add("ERR", self._us(now), kind, active)

    def command(self, now: float, index: int, total: int, item: Item) -> None:
        parameters = (item.param1, item.param2, item.param3, item.param4)
        self._add(
            "CMD", self._us(now), total, index, item.command, *parameters, item.x, item.y, item.z, item.frame
        )

    def parameter(self, now: float, name: str, value: float) -> None:
        default = self._defaults.get(name, math.nan)
        self._add("PARM", self._us(now), name.encode()[:16], value, default)

    def strike(self, now: float, count: int, over: tuple[int, int], by: tuple[int, int]) -> None:
        self._add("STRK", self._us(now), count, *over, *by)


def _e7(degrees: float) -> int:
    return round(degrees * 1e7) if math.isfinite(degrees) else 0


def _cm(metres: float) -> int:
    return min(max(round(metres * 100), -_MAX_I32), _MAX_I32) if math.isfinite(metres) else 0
