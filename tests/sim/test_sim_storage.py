"""A vehicle's logs and files from the outside: flights, downloaded logs, and files."""

import struct
from pathlib import Path
from typing import Any

import pytest
from files_client import FileStation, of, read_dataflash
from pymavlink import mavftp
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import VEHICLE, home_item, land, scenario, takeoff, waypoint

from sim_vehicle.files.ftp import HEADER
from sim_vehicle.files.ftp_rules import Opcode
from sim_vehicle.files.packed_files import Parameter, pack_parameters
from sim_vehicle.fleet import Fleet


def fleet(**spec: Any) -> Fleet:
    return Fleet(scenario(vehicles=[VEHICLE | spec]), ready_s=0.0)


class Ground(FileStation):
    """A station with log and file messages."""

    def log_list(self) -> list[Any]:
        before = len(self.received)
        self.send(mavlink.MAVLink_log_request_list_message(self.target, 1, 0, 0xFFFF))
        self.wait(0.5)
        return [m for m in self.received[before:] if m.get_type() == "LOG_ENTRY"]

    def log(self, log_id: int) -> bytes:
        before = len(self.received)
        self.send(mavlink.MAVLink_log_request_data_message(self.target, 1, log_id, 0, 2**32 - 1))
        self.until(lambda: self.of("LOG_DATA") and self.of("LOG_DATA")[-1].count < 90, 60)
        chunks = {
            m.ofs: bytes(m.data[: m.count]) for m in self.received[before:] if m.get_type() == "LOG_DATA"
        }
        self.send(mavlink.MAVLink_log_request_end_message(self.target, 1))
        return b"".join(chunks[offset] for offset in sorted(chunks))

    def put(self, path: bytes, content: bytes) -> None:
        self.ftp(Opcode.CREATE_FILE, path)
        for offset in range(0, len(content), 200):
            self.ftp(Opcode.WRITE_FILE, content[offset : offset + 200], offset=offset)
        self.ftp(Opcode.TERMINATE_SESSION)

    def hop(self) -> None:
        """Take off, land, and wait until the motors stop."""
        self.fly(10.0)
        assert self.set_mode("LAND") == 0
        self.until(lambda: not self.armed)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Ground, list[Any]]:
    """Return the station after a mission of an ArduCopter, and the downloaded log."""
    station = Ground(fleet())
    station.stream(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, hz=10.0)
    station.fly_mission([takeoff(15.0), waypoint(40.0, 0.0, 15.0), land(40.0, 30.0)])
    station.until(lambda: not station.armed)
    (entry,) = station.log_list()
    content = station.log(entry.id)
    assert len(content) == entry.size
    return station, read_dataflash(content, tmp_path_factory.mktemp("log") / "a.BIN")


@pytest.mark.autopilots("MAVSDK 5 log_files")
def test_positions_in_the_log_agree_with_telemetry(flown: tuple[Ground, list[Any]]) -> None:
    station, messages = flown
    sent_positions = {m.time_boot_ms: m for m in station.of("GLOBAL_POSITION_INT")}
    compared = 0
    for logged in of(messages, "POS"):
        message = sent_positions.get(round(logged.TimeUS / 1000))
        if message is not None:
            compared += 1
            assert abs(logged.Lat - message.lat * 1e-7) < 2e-7
            assert abs(logged.Alt - message.alt * 1e-3) < 0.01
            assert abs(logged.RelHomeAlt - message.relative_alt * 1e-3) < 0.01
    assert compared > 50
    assert max(m.RelHomeAlt for m in of(messages, "POS")) == pytest.approx(15.0, abs=1.0)


def test_the_log_has_texts_events_modes_and_items_of_the_flight(flown: tuple[Ground, list[Any]]) -> None:
    station, messages = flown
    texts = [m.Message for m in of(messages, "MSG")]
    assert texts[0].startswith("ArduCopter V4.6.2")
    sent = station.texts()
    flight = sent[sent.index("Arming motors") : sent.index("Disarming motors") + 1]
    assert [text for text in texts if text in flight] == flight
    assert [m.Id for m in of(messages, "EV")] == [10, 28, 18, 11]
    modes = [m.ModeNum for m in of(messages, "MODE")]
    assert (modes[0], modes[-1]) == (4, 3)
    assert [m.CNum for m in of(messages, "CMD")] == [1, 2, 3]
    assert {m.Name: m.Value for m in of(messages, "PARM")}["RTL_ALT"] == 1500
    used = [m.CurrTot for m in of(messages, "BAT")]
    assert used == sorted(used)
    assert used[-1] > used[0]


def test_each_flight_is_a_log_and_they_can_be_erased() -> None:
    station = Ground(fleet())
    assert [(m.num_logs, m.size) for m in station.log_list()] == [(0, 0)]
    for _ in range(2):
        station.hop()
        station.wait(5.0)
    entries = station.log_list()
    assert [(m.id, m.num_logs, m.last_log_num) for m in entries] == [(1, 2, 2), (2, 2, 2)]
    assert entries[0].time_utc < entries[1].time_utc
    assert station.file(b"/APM/LOGS/00000002.BIN") == station.log(2)
    assert station.file(b"/APM/LOGS/LASTLOG.TXT") == b"2\r\n"
    station.send(mavlink.MAVLink_log_erase_message(1, 1))
    assert [m.num_logs for m in station.log_list()] == [0]


def test_ardupilot_refuses_a_download_while_armed() -> None:
    station = Ground(fleet())
    station.fly(10.0)
    assert station.log_list() == []
    assert station.texts()[-1] == "Disarm for log download"


def test_a_parameter_set_in_flight_and_a_failsafe_are_in_the_log(tmp_path: Path) -> None:
    station = Ground(fleet())
    station.fly(10.0)
    for name, value in (("BATT_FS_LOW_ACT", 1), ("BATT_LOW_VOLT", 13.0)):
        station.set_parameter(name, value)
    station.until(lambda: not station.armed)
    messages = read_dataflash(station.log(1), tmp_path / "a.BIN")
    assert [m.Value for m in of(messages, "PARM") if m.Name == "BATT_LOW_VOLT"] == [10.5, 13.0]
    assert [(m.Subsys, m.ECode) for m in of(messages, "ERR")] == [(6, 1)]
    assert [m.ModeNum for m in of(messages, "MODE")] == [4, 9]


def test_log_disarmed_records_from_the_boot_and_a_backend_of_none_never() -> None:
    always = Ground(fleet(params={"LOG_DISARMED": 1}))
    always.wait(3.0)
    assert [(m.id, m.num_logs) for m in always.log_list()] == [(1, 1)]
    never = Ground(fleet(params={"LOG_BACKEND_TYPE": 0}))
    never.hop()
    assert [m.num_logs for m in never.log_list()] == [0]


def test_a_reboot_ends_the_log_and_keeps_it() -> None:
    station = Ground(fleet())
    station.hop()
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == 0
    station.wait(5.0)
    (entry,) = station.log_list()
    assert len(station.log(entry.id)) == entry.size > 0


def test_the_parameters_are_downloaded_as_a_file() -> None:
    station = Ground(fleet(params={"RTL_ALT": 3000}))
    data = mavftp.MAVFTP.ftp_param_decode(station.file(b"@PARAM/param.pck?withdefaults=1"))
    assert data is not None
    values = {name.decode(): value for name, value, _ in data.params}
    assert values["RTL_ALT"] == 3000
    station.send(mavlink.MAVLink_param_request_list_message(1, 1))
    assert {m.param_id: m.param_value for m in station.of("PARAM_VALUE")} == pytest.approx(values)
    assert any(text.startswith("ArduCopter V4.6.2") for text in station.texts())


def parameter_file(*rows: Parameter) -> bytes:
    content = pack_parameters(rows)
    return content[:4] + struct.pack("<H", len(content)) + content[6:]


def test_uploaded_parameters_are_set_and_unknown_ones_are_ignored() -> None:
    station = Ground(fleet())
    rows = [
        Parameter("ARMING_CHECK", 0, 0),
        Parameter("NO_SUCH", 5, 5),
        Parameter("BATT_LOW_VOLT", 12.5, 0.0),
    ]
    station.put(b"@PARAM/param.pck", parameter_file(*rows))
    assert (station.parameter("ARMING_CHECK"), station.parameter("BATT_LOW_VOLT")) == (0, 12.5)
    with pytest.raises(AssertionError, match="FAIL"):
        station.put(b"@PARAM/param.pck", parameter_file(Parameter("RTL_ALT", 2000, 0))[:-1])
    assert station.parameter("RTL_ALT") == 1500


def test_a_reboot_discards_an_unfinished_upload() -> None:
    station = Ground(fleet())
    station.ftp(Opcode.CREATE_FILE, b"@PARAM/param.pck")
    station.ftp(Opcode.WRITE_FILE, b"half")
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == 0
    station.wait(5.0)
    assert mavftp.MAVFTP.ftp_param_decode(station.file(b"@PARAM/param.pck")) is not None


def test_a_mission_is_uploaded_as_a_file() -> None:
    station = Ground(fleet())
    assert station.upload([home_item(), takeoff(), waypoint(10, 10)]) == 0
    content = station.file(b"@MISSION/mission.dat")
    assert struct.unpack_from("<HHHHH", content) == (0x763D, 0, 0, 0, 3)
    longer = content[:8] + struct.pack("<H", 4) + content[10:] + content[-38:]
    station.put(b"@MISSION/mission.dat", longer)
    assert [m.command for m in station.download()] == [16, 22, 16, 16]
    for wrong in (longer[:-1], longer[:-38] + bytes(38), b"\0" + longer[1:], longer[:2] + b"\1" + longer[3:]):
        with pytest.raises(AssertionError, match="FAIL"):
            station.put(b"@MISSION/mission.dat", wrong)
    station.inject("mission_refused")
    with pytest.raises(AssertionError, match="FAIL"):
        station.put(b"@MISSION/mission.dat", content)
    assert [m.command for m in station.download()] == [16, 22, 16, 16]


# -- PX4 -------------------------------------------------------------------------------------------------


def px4(**spec: Any) -> Ground:
    station = Ground(fleet(personality="px4", **spec))
    station.wait(2.0)
    return station


@pytest.mark.autopilots("MAVSDK 5 log_files", of="px4")
def test_px4_logs_from_the_boot_to_the_first_disarming_and_then_each_flight() -> None:
    station = px4()
    assert [(m.id, m.num_logs) for m in station.log_list()] == [(0, 1)]
    content = station.log(0)
    assert content.startswith(b"ULog\x01\x12\x35\x01")
    for name in (b"vehicle_attitude", b"vehicle_global_position", b"battery_status", b"vehicle_status"):
        assert name in content
    for n_logs in (1, 2):
        for armed in (1, 0):
            assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, armed) == 0
            station.wait(2.0)
        assert len(station.log_list()) == n_logs


def test_logs_of_px4_are_files_by_day_and_time() -> None:
    station = px4()
    (day,) = [
        line
        for line in station.ftp(Opcode.LIST_DIRECTORY, b"/fs/microsd/log").split(b"\0")
        if line[:1] == b"D"
    ]
    assert day == b"D2026-01-01"
    lines = station.ftp(Opcode.LIST_DIRECTORY, b"/fs/microsd/log/2026-01-01").split(b"\0")
    assert [line.split(b"\t")[0] for line in lines if line[:1] == b"F"] == [b"F00_00_00.ulg"]


@pytest.mark.parametrize(("personality", "answers"), [("ardupilot", 1), ("px4", 0)])
def test_only_ardupilot_serves_files_to_any_component(personality: str, answers: int) -> None:
    station = Ground(fleet(personality=personality))
    payload = HEADER.pack(1, 0, Opcode.NONE, 0, 0, 0, 0).ljust(251, b"\0")
    replies = station.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 77, payload))
    assert sum(m.get_type() == "FILE_TRANSFER_PROTOCOL" for m in replies) == answers
