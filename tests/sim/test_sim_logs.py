"""Flight logs, read by pymavlink (DataFlash) and by a reader of the ULog definition."""

import math
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from files_client import of, read_dataflash
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink import DFReader

from sim_vehicle.files.logs.dataflash import DataFlashLog
from sim_vehicle.files.logs.record import Failsafe, FlightLog, LogStart, Sample
from sim_vehicle.files.logs.recorder import FLEET_BYTES, FlightRecorder, LogLimits, limits_for
from sim_vehicle.files.logs.ulog import UlogLog
from sim_vehicle.vehicle.mission import Item

UTC_S = 1_763_683_200.0  # 2025-11-21 00:00:00
BOOT_S = 5.0
ARM_S = 65.0
HOME = (47.397, 8.545, 488.0)
BOTH = pytest.mark.parametrize("format_", [DataFlashLog, UlogLog], ids=["dataflash", "ulog"])


def log_start(**changes: Any) -> LogStart:
    parameters = {"SYSID": 3, "SPEED": 7.5}
    values: dict[str, Any] = {
        "utc_s": UTC_S, "boot_s": BOOT_S, "banner": ("ArduCopter V4.6.2 (sim)", "Frame: QUAD/X"),
        "flight_sw_version": 0x010F02FF, "parameters": parameters, "defaults": {"SYSID": 1, "SPEED": 7.5},
        "mode": 4,
    }  # fmt: skip
    return LogStart(**(values | changes))


def sample(**changes: Any) -> Sample:
    values: dict[str, Any] = {
        "lat_deg": 47.3971, "lon_deg": 8.5452, "alt_amsl_m": 508.0, "above_home_m": 20.0,
        "north_m": 11.0, "east_m": 15.0, "up_m": 20.0,
        "north_m_s": 3.0, "east_m_s": 4.0, "down_m_s": -0.5,
        "roll_rad": 0.1, "pitch_rad": -0.2, "yaw_rad": 1.5,
        "voltage_v": 12.1, "current_a": 15.0, "used_mah": 120.0, "used_wh": 1.4, "remaining": 0.9,
        "gps_fix": 3, "gps_satellites": 10, "gps_hdop": 0.8,
        "gps_lat_deg": 47.39711, "gps_lon_deg": 8.54519, "gps_alt_amsl_m": 507.5,
    }  # fmt: skip
    return Sample(**(values | changes))


def flight(log: FlightLog, *, mode: int = 4, next_mode: int = 6) -> None:
    """Write each kind of entry once, at known times."""
    log.begin(ARM_S, log_start(mode=mode))
    log.origin(ARM_S, *HOME)
    log.home(ARM_S, *HOME)
    log.armed(ARM_S, True)
    log.landed(ARM_S + 1, False)
    for tick in range(30):
        log.sample(ARM_S + 1 + tick / 10, sample(alt_amsl_m=500.0 + tick))
    log.command(ARM_S + 2, 1, 5, Item(16, 3, 1.0, 2.0, 3.0, math.nan, 473_980_000, 85_460_000, 20.0))
    log.text(ARM_S + 3, 4, "Battery 1 is low")
    log.failsafe(ARM_S + 3, Failsafe.BATTERY, True)
    log.mode(ARM_S + 3, next_mode)
    log.parameter(ARM_S + 4, "SPEED", 5.0)
    log.strike(ARM_S + 5, 1, (2, 3), (4, 5))
    log.failsafe(ARM_S + 6, Failsafe.BATTERY, False)
    log.landed(ARM_S + 8, True)
    log.armed(ARM_S + 9, False)


# -- DataFlash -------------------------------------------------------------------------------------------


@pytest.fixture
def dataflash(tmp_path: Path) -> list[Any]:
    log = DataFlashLog()
    flight(log)
    return read_dataflash(bytes(log.content), tmp_path / "flight.BIN")


def test_pymavlink_reads_the_state_of_a_dataflash_log(dataflash: list[Any]) -> None:
    first, *_, last = of(dataflash, "POS")
    assert (first.TimeUS, last.TimeUS) == (61_000_000, 63_900_000)
    assert (first.Lat, first.Lng, first.Alt, last.Alt) == (47.3971, 8.5452, 500.0, 529.0)
    attitude = of(dataflash, "ATT")[0]
    assert (attitude.Roll, attitude.Pitch, attitude.Yaw) == pytest.approx(
        (math.degrees(0.1), math.degrees(-0.2), math.degrees(1.5)), rel=1e-6
    )
    gps = of(dataflash, "GPS")[0]
    assert (gps.Status, gps.NSats, gps.Lat, gps.Lng, gps.Alt) == (3, 10, 47.39711, 8.54519, 507.5)
    assert (gps.HDop, gps.Spd, gps.VZ) == pytest.approx((0.8, 5.0, -0.5))
    assert gps.GCrs == pytest.approx(53.13, abs=0.01)
    battery = of(dataflash, "BAT")[0]
    assert (battery.Volt, battery.Curr, battery.CurrTot, battery.RemPct) == pytest.approx(
        (12.1, 15.0, 120.0, 90)
    )


def test_a_dataflash_log_has_the_time_of_day(dataflash: list[Any]) -> None:
    """The reader computes the time of day from GPS week and time of week."""
    assert of(dataflash, "POS")[0]._timestamp == pytest.approx(UTC_S + 1, abs=0.01)


def test_a_dataflash_log_has_the_events(dataflash: list[Any]) -> None:
    assert [m.Message for m in of(dataflash, "MSG")] == [
        "ArduCopter V4.6.2 (sim)", "Frame: QUAD/X", "Battery 1 is low",
    ]  # fmt: skip
    assert [(m.TimeUS, m.Mode) for m in of(dataflash, "MODE")] == [(60_000_000, 4), (63_000_000, 6)]
    assert [m.Id for m in of(dataflash, "EV")] == [10, 28, 18, 11]
    assert [(m.Subsys, m.ECode) for m in of(dataflash, "ERR")] == [(6, 1), (6, 0)]
    assert [(m.Name, m.Value, m.Default) for m in of(dataflash, "PARM")] == [
        ("SYSID", 3, 1), ("SPEED", 7.5, 7.5), ("SPEED", 5, 7.5),
    ]  # fmt: skip
    (command,) = of(dataflash, "CMD")
    assert (command.CTot, command.CNum, command.CId, command.Lat, command.Alt) == (5, 1, 16, 47.398, 20)
    assert math.isnan(command.Prm4)
    (strike,) = of(dataflash, "STRK")
    assert (strike.Count, strike.Row, strike.Col, strike.ByRow, strike.ByCol) == (1, 2, 3, 4, 5)
    assert [(m.Type, m.Lat, m.Alt) for m in of(dataflash, "ORGN")] == [(0, 47.397, 488), (1, 47.397, 488)]


def test_every_dataflash_format_has_the_size_of_its_fields_and_units(dataflash: list[Any]) -> None:
    units = {m.FmtType: m for m in of(dataflash, "FMTU")}
    known = {m.Id for m in of(dataflash, "UNIT")}
    factors = {m.Id for m in of(dataflash, "MULT")}
    for message in of(dataflash, "FMT"):
        columns = message.Columns.split(",")
        size = 3 + struct.calcsize("<" + "".join(DFReader.FORMAT_TO_STRUCT[c][0] for c in message.Format))
        assert (message.Length, len(message.Format)) == (size, len(columns))
        if message.Name != "FMT":
            assert len(units[message.Type].UnitIds) == len(units[message.Type].MultIds) == len(columns)
        assert {ord(c) for c in units[message.Type].UnitIds} <= known
        assert {ord(c) for c in units[message.Type].MultIds} <= factors


# -- ULog ------------------------------------------------------------------------------------------------

ULOG_TYPES = {"uint64_t": "<u8", "int32_t": "<i4", "uint32_t": "<u4", "uint16_t": "<u2", "int16_t": "<i2",
              "uint8_t": "u1", "float": "<f4", "double": "<f8", "bool": "?"}  # fmt: skip


@dataclass
class Ulog:
    """The content of a ULog file, read by the format's definition."""

    start_us: int = 0
    info: dict[str, Any] = field(default_factory=dict)
    initial: dict[str, float] = field(default_factory=dict)
    changed: list[tuple[str, float]] = field(default_factory=list)
    texts: list[tuple[int, int, str]] = field(default_factory=list)  # level, us, text
    topics: dict[str, list[Any]] = field(default_factory=dict)


def read_ulog(content: bytes) -> Ulog:
    magic, start_us = struct.unpack_from("<8sQ", content)
    assert magic == b"ULog\x01\x12\x35\x01"
    log, formats, names = Ulog(start_us), {}, {}
    at, number, defining = 16, 0, True
    while at < len(content):
        size, kind = struct.unpack_from("<Hc", content, at)
        body = content[at + 3 : at + 3 + size]
        assert len(body) == size
        assert (number == 0) == (kind == b"B"), "flags come first and once"
        if kind == b"F":
            assert defining
            name, _, fields = body.decode().partition(":")
            formats[name] = np.dtype([ulog_field(text) for text in filter(None, fields.split(";"))])
        elif kind in b"IP":
            key_type, key = body[1 : 1 + body[0]].decode().split(" ")
            raw = body[1 + body[0] :]
            if key_type.startswith("char["):
                assert len(raw) == int(key_type[5:-1])
                log.info[key] = raw.decode()
            else:
                assert len(raw) == np.dtype(ULOG_TYPES[key_type]).itemsize
                value = np.frombuffer(raw, ULOG_TYPES[key_type])[0].item()
                if kind == b"I":
                    log.info[key] = value
                elif defining:
                    log.initial[key] = value
                else:
                    log.changed.append((key, value))
        elif kind == b"A":
            defining = False
            _, topic_id = struct.unpack_from("<BH", body)
            names[topic_id] = body[3:].decode()
        elif kind == b"D":
            name = names[struct.unpack_from("<H", body)[0]]
            assert len(body) == 2 + formats[name].itemsize
            log.topics.setdefault(name, []).append(np.frombuffer(body[2:], formats[name])[0])
        elif kind == b"L":
            level, us = struct.unpack_from("<BQ", body)
            log.texts.append((level - ord("0"), us, body[9:].decode()))
        else:
            assert kind == b"B", kind
        at += 3 + size
        number += 1
    assert at == len(content)
    return log


def ulog_field(text: str) -> Any:
    kind, name = text.split(" ")
    kind, _, length = kind.partition("[")
    return (name, ULOG_TYPES[kind], (int(length[:-1]),)) if length else (name, ULOG_TYPES[kind])


@pytest.fixture
def ulog() -> Ulog:
    log = UlogLog()
    flight(log, mode=4 << 16 | 4 << 24, next_mode=4 << 16 | 5 << 24)
    return read_ulog(bytes(log.content))


def test_a_ulog_has_the_state(ulog: Ulog) -> None:
    assert ulog.start_us == 60_000_000
    first, last = (ulog.topics["vehicle_global_position"][i] for i in (0, -1))
    assert (first["timestamp"], last["timestamp"]) == (61_000_000, 63_900_000)
    assert (first["lat"], first["lon"], first["alt"], last["alt"]) == (47.3971, 8.5452, 500.0, 529.0)
    local = ulog.topics["vehicle_local_position"][0]
    assert [float(local[n]) for n in ("x", "y", "z", "vx", "vy", "vz")] == [11.0, 15.0, -20.0, 3.0, 4.0, -0.5]
    assert (local["ref_lat"], local["ref_alt"]) == (47.397, 488.0)
    gps = ulog.topics["vehicle_gps_position"][0]
    assert gps["time_utc_usec"] == round((UTC_S + 1) * 1e6)
    assert (gps["latitude_deg"], gps["fix_type"], gps["satellites_used"]) == (47.39711, 3, 10)
    battery = ulog.topics["battery_status"][0]
    assert [float(battery[n]) for n in ("voltage_v", "current_a", "remaining")] == pytest.approx(
        [12.1, 15, 0.9]
    )


def test_a_ulogs_attitude_is_the_rotation_by_yaw_pitch_and_roll(ulog: Ulog) -> None:
    w, x, y, z = (float(v) for v in ulog.topics["vehicle_attitude"][0]["q"])
    assert w * w + x * x + y * y + z * z == pytest.approx(1.0, abs=1e-6)
    assert math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) == pytest.approx(0.1, abs=1e-6)
    assert math.asin(2 * (w * y - z * x)) == pytest.approx(-0.2, abs=1e-6)
    assert math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(1.5, abs=1e-6)


def test_a_ulog_has_the_events(ulog: Ulog) -> None:
    assert (ulog.info["sys_name"], ulog.info["ver_sw_release"]) == ("PX4", 0x010F02FF)
    assert ulog.initial == {"SYSID": 3, "SPEED": 7.5}
    assert ulog.changed == [("SPEED", 5.0)]
    assert ulog.texts == [(4, 63_000_000, "Battery 1 is low")]
    status = [
        (int(s["arming_state"]), int(s["nav_state"]), bool(s["failsafe"]))
        for s in ulog.topics["vehicle_status"]
    ]
    assert status == [(1, 3, False), (2, 3, False), (2, 3, True), (2, 5, True), (2, 5, False), (1, 5, False)]
    assert [bool(s["landed"]) for s in ulog.topics["vehicle_land_detected"]] == [False, True]
    (mission,) = ulog.topics["mission_result"]
    assert (mission["seq_current"], mission["seq_total"], mission["item_command"]) == (1, 5, 16)
    (strike,) = ulog.topics["strike"]
    assert [int(strike[n]) for n in ("count", "row", "col", "by_row", "by_col")] == [1, 2, 3, 4, 5]
    (home,) = ulog.topics["home_position"]
    assert (home["lat"], home["lon"], home["alt"]) == HOME


# -- both ------------------------------------------------------------------------------------------------

ANGLES = st.floats(-math.pi, math.pi)


@BOTH
@settings(max_examples=examples(50))
@given(
    numbers=st.lists(st.floats(-1e4, 1e4) | st.just(math.nan), min_size=9, max_size=9),
    angles=st.tuples(ANGLES, ANGLES, ANGLES),
    hdop=st.floats(0, 1e6),
    text=st.text(max_size=80),
    utc_s=st.floats(0, 4e9),
)
def test_any_state_of_a_vehicle_can_be_logged(
    format_: Any,
    numbers: list[float],
    angles: tuple[float, float, float],
    hdop: float,
    text: str,
    utc_s: float,
) -> None:
    log = format_()
    log.begin(ARM_S, log_start(utc_s=utc_s, banner=()))
    lat_deg, lon_deg, alt_m, up_m, north_m, east_m, gps_lat_deg, gps_alt_m, current_a = numbers
    roll_rad, pitch_rad, yaw_rad = angles
    log.sample(
        ARM_S,
        sample(
            lat_deg=lat_deg % 90, lon_deg=lon_deg % 180, alt_amsl_m=alt_m, up_m=up_m, north_m=north_m,
            east_m=east_m, gps_lat_deg=gps_lat_deg % 90, gps_alt_amsl_m=gps_alt_m, current_a=current_a,
            roll_rad=roll_rad, pitch_rad=pitch_rad, yaw_rad=yaw_rad, gps_hdop=hdop,
        ),
    )  # fmt: skip
    before = len(log.content)
    log.text(ARM_S, 9, text)
    log.mode(ARM_S, 2**32 - 1)
    assert len(log.content) > before


# -- recorder --------------------------------------------------------------------------------------------


def recorded(recorder: FlightRecorder, start_s: float, seconds: float) -> None:
    recorder.begin(start_s, log_start(utc_s=UTC_S + start_s))
    for tick in range(round(seconds * 10)):
        now = start_s + tick / 10
        if recorder.due(now):
            recorder.sample(now, sample())
    recorder.end(start_s + seconds)


def test_each_flight_is_a_log_and_the_oldest_is_erased_first(tmp_path: Path) -> None:
    recorder = FlightRecorder(DataFlashLog, LogLimits(logs=3))
    assert not recorder.due(0.0)
    for start_s in (10.0, 20.0, 30.0, 40.0):
        recorded(recorder, start_s, 5.0)
    assert [log.number for log in recorder.logs] == [2, 3, 4]
    assert [log.utc_s for log in recorder.logs] == [UTC_S + 25, UTC_S + 35, UTC_S + 45]
    messages = read_dataflash(bytes(recorder.logs[0].content), tmp_path / "a.BIN")
    assert len(of(messages, "ATT")) == 50
    recorder.erase()
    assert recorder.logs == []
    recorded(recorder, 50.0, 1.0)
    assert [log.number for log in recorder.logs] == [1]


def test_samples_come_at_the_rate_of_the_limits(tmp_path: Path) -> None:
    recorder = FlightRecorder(DataFlashLog, LogLimits(rate_hz=2.0))
    recorded(recorder, 10.0, 10.0)
    messages = read_dataflash(bytes(recorder.logs[0].content), tmp_path / "a.BIN")
    assert [m.TimeUS for m in of(messages, "ATT")] == [5_000_000 + 500_000 * i for i in range(20)]


def test_a_full_log_accepts_events_but_no_samples(tmp_path: Path) -> None:
    recorder = FlightRecorder(DataFlashLog, LogLimits(log_bytes=20_000))
    recorder.begin(10.0, log_start())
    for tick in range(1000):
        recorder.sample(10 + tick / 10, sample())
    log = recorder.log_for_event(200.0)
    assert log is not None
    log.mode(200.0, 9)
    for _ in range(1000):
        if (log := recorder.log_for_event(201.0)) is not None:
            log.text(201.0, 6, "again")
    (stored,) = recorder.logs
    assert len(stored.content) <= 20_000 + 100
    messages = read_dataflash(bytes(stored.content), tmp_path / "a.BIN")
    assert of(messages, "MODE")[-1].Mode == 9
    assert "Log is full, samples stop" in [m.Message for m in of(messages, "MSG")]


def test_a_recorder_without_room_records_nothing() -> None:
    recorder = FlightRecorder(DataFlashLog, LogLimits(logs=0))
    recorded(recorder, 10.0, 1.0)
    assert (recorder.logs, recorder.log_for_event(10.5), recorder.recording) == ([], None, False)


def test_erasing_the_current_log_ends_it() -> None:
    recorder = FlightRecorder(DataFlashLog, LogLimits())
    recorder.begin(10.0, log_start())
    recorder.remove(recorder.logs[0])
    assert (recorder.logs, recorder.recording, recorder.due(11.0)) == ([], False, False)
    recorder.end(12.0)


@given(size=st.integers(1, 2000))
@settings(max_examples=examples(50))
def test_the_logs_of_a_fleet_stay_within_bounds(size: int) -> None:
    limits = limits_for(size)
    assert size * limits.logs * limits.log_bytes <= FLEET_BYTES
    assert limits.rate_hz == 10.0 if size <= 75 else 0.3 < limits.rate_hz <= 10.0
    log = UlogLog()
    log.sample(0.0, sample())
    assert limits.log_bytes >= 600 * limits.rate_hz * len(log.content), "ten minutes fit"
