"""ArduPilot's packed files, read by pymavlink's decoder, and the file trees."""

import struct
from typing import Any

import pytest
from files_client import FtpClient, pymavlink_ftp
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink import mavftp
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.files import ftp_rules as ftp
from sim_vehicle.files.component_metadata import Component, ComponentMetadata
from sim_vehicle.files.filesystem import FileError, FileSystem, constant
from sim_vehicle.files.ftp_rules import FtpError, Opcode
from sim_vehicle.files.logs.dataflash import DataFlashLog
from sim_vehicle.files.logs.recorder import FlightRecorder, LogLimits, StoredLog
from sim_vehicle.files.packed_files import Parameter, pack_parameters, unpack_mission, unpack_parameters
from sim_vehicle.files.vehicle_files import ardupilot_files, px4_files, px4_log_name

NAMES = st.text(alphabet="ABC_12", min_size=1, max_size=16)
VALUES = st.one_of(st.integers(-(2**31), 2**31 - 1), st.floats(width=32, allow_nan=False))
FEW = [
    Parameter("ARMING_CHECK", 1, 1),
    Parameter("BATT_LOW_VOLT", 11.0, 10.5),
    Parameter("BATT_LOW_MAH", 0.0, 0.0),
    Parameter("BATT", 0, 0),
]


def decoded(content: bytes) -> Any:
    return mavftp.MAVFTP.ftp_param_decode(content)


def made(parameters: dict[str, tuple[float, float]]) -> list[Parameter]:
    same = [(name, v, type(v)(d)) for name, (v, d) in parameters.items()]
    return [Parameter(name, value, default) for name, value, default in same]


@settings(derandomize=True, deadline=None, max_examples=examples(150))
@given(
    parameters=st.dictionaries(
        NAMES, VALUES.flatmap(lambda v: st.tuples(st.just(v), st.just(v) | st.just(type(v)(7)))), min_size=1
    ),
    defaults=st.booleans(),
)
def test_pymavlink_reads_packed_parameters(
    parameters: dict[str, tuple[float, float]], defaults: bool
) -> None:
    """Names have any order and any common beginnings."""
    content = pack_parameters(made(parameters), "withdefaults=1" if defaults else "")
    data = decoded(content)
    assert {name.decode(): value for name, value, _ in data.params} == {
        name: value for name, (value, _) in parameters.items()
    }
    if defaults:
        assert {name.decode(): value for name, value, _ in data.defaults} == {
            name: default for name, (_, default) in parameters.items()
        }


@settings(derandomize=True, deadline=None, max_examples=examples(60))
@given(
    parameters=st.dictionaries(NAMES, VALUES, min_size=1, max_size=30),
    start=st.integers(0, 29),
    count=st.integers(0, 40),
)
def test_a_query_selects_a_part_of_the_parameters(
    parameters: dict[str, float], start: int, count: int
) -> None:
    rows = [Parameter(name, value, value) for name, value in parameters.items()]
    query = f"start={start}&count={count}"
    if start >= len(rows):
        with pytest.raises(FileError):
            pack_parameters(rows, query)
        return
    content = pack_parameters(rows, query)
    chosen = rows[start : start + count] if count else rows[start:]
    assert struct.unpack_from("<HHH", content) == (0x671B, len(chosen), len(rows))
    whole = content[:4] + struct.pack("<H", len(content)) + content[6:]
    assert unpack_parameters(whole) == {row.name: row.value for row in chosen}


@pytest.mark.parametrize("query", ["start=-1", "count=x", "withdefaults=2", "start=65535", "start=²"])
def test_a_bad_query_is_refused(query: str) -> None:
    with pytest.raises(FileError):
        pack_parameters(FEW, query)


@settings(derandomize=True, deadline=None, max_examples=examples(200))
@given(content=st.binary(max_size=200), head=st.booleans())
def test_any_upload_is_accepted_or_refused(content: bytes, head: bool) -> None:
    if head:
        content = struct.pack("<HHH", 0x671B, 3, len(content) + 6) + content
    parameters = unpack_parameters(content)
    assert parameters is None or all(isinstance(name, str) for name in parameters)
    assert unpack_mission(0, content) is None  # too short, or another kind of file
    items = len(content) // 38
    mission = unpack_mission(0, struct.pack("<HHHHH", 0x763D, 0, 0, 0, items) + content)
    assert (mission is not None) == (len(content) == 38 * items)


# -- the vehicle's tree ----------------------------------------------------------------------------------


class Vehicle:
    """The parameters and mission items of an ArduPilot's files."""

    def __init__(self) -> None:
        self.values = {row.name: row for row in FEW}
        self.missions: dict[int, list[Any]] = {0: [item(0), item(1)], 1: [], 2: []}
        self.banners = 0
        self.recorder = FlightRecorder(DataFlashLog, LogLimits())
        self.files = ardupilot_files(
            parameters=lambda: list(self.values.values()),
            set_parameter=self._set,
            banner=self._banner,
            items=lambda kind: self.missions[kind],
            set_items=self._set_items,
            recorder=self.recorder,
            system={"uarts.txt": constant(b"UARTV1\n")},
        )

    def _set(self, name: str, value: float) -> None:
        if name in self.values:
            self.values[name] = self.values[name]._replace(value=value)

    def _banner(self) -> None:
        self.banners += 1

    def _set_items(self, kind: int, upload: Any) -> bool:
        if upload.start:
            return False
        self.missions[kind] = upload.items
        return True


def item(seq: int) -> Any:
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, seq, 3, 16, 0, 1, 1.0, 2.0, 3.0, 4.0, 473_970_000 + seq, 85_450_000, 20.0, 0
    )


def test_pymavlink_downloads_the_parameters_with_their_defaults() -> None:
    vehicle = Vehicle()
    client = pymavlink_ftp(FtpClient(vehicle.files, ftp.ARDUPILOT))
    seen: list[Any] = []

    def take(handle: Any) -> mavftp.MAVFTPReturn:
        seen.append(decoded(handle.read()))
        return mavftp.MAVFTPReturn("GetParams", mavftp.FtpError.Success)

    client.cmd_get(["@PARAM/param.pck?withdefaults=1"], callback=take)
    client.process_ftp_reply("OpenFileRO", timeout=10)
    (data,) = seen
    assert [(n.decode(), v) for n, v, _ in data.params] == [(row.name, row.value) for row in FEW]
    assert [(n.decode(), v) for n, v, _ in data.defaults] == [(row.name, row.default) for row in FEW]
    assert vehicle.banners == 1


def upload(client: FtpClient, path: bytes, content: bytes) -> int:
    """Create, write and close a file; return the opcode of the last answer."""
    client.one(Opcode.CREATE_FILE, path)
    for offset in range(0, len(content), 80):
        client.one(Opcode.WRITE_FILE, content[offset : offset + 80], offset=offset)
    return client.one(Opcode.TERMINATE_SESSION).opcode


def test_uploaded_parameters_are_set_and_unknown_ones_ignored() -> None:
    vehicle = Vehicle()
    client = FtpClient(vehicle.files, ftp.ARDUPILOT)
    rows = [
        Parameter("ARMING_CHECK", 0, 0),
        Parameter("NO_SUCH", 5, 5),
        Parameter("BATT_LOW_VOLT", 12.5, 0.0),
    ]
    content = pack_parameters(rows)
    content = content[:4] + struct.pack("<H", len(content)) + content[6:]
    assert upload(client, b"@PARAM/param.pck", content) == Opcode.ACK
    assert vehicle.values["ARMING_CHECK"].value == 0
    assert vehicle.values["BATT_LOW_VOLT"].value == 12.5
    assert set(vehicle.values) == {row.name for row in FEW}
    assert upload(client, b"@PARAM/param.pck", content[:-1]) == Opcode.NAK
    assert decoded(vehicle.files.read("@PARAM/param.pck")) is not None


def test_a_reboot_discards_an_unfinished_upload() -> None:
    vehicle = Vehicle()
    client = FtpClient(vehicle.files, ftp.ARDUPILOT)
    client.one(Opcode.CREATE_FILE, b"@PARAM/param.pck")
    client.one(Opcode.WRITE_FILE, b"half", offset=0)
    client.server.reset()
    data = decoded(vehicle.files.read("@PARAM/param.pck"))
    assert [(n.decode(), v) for n, v, _ in data.params] == [(row.name, row.value) for row in FEW]


def test_a_mission_is_read_and_replaced_as_a_file() -> None:
    vehicle = Vehicle()
    client = FtpClient(vehicle.files, ftp.ARDUPILOT)
    content = vehicle.files.read("@MISSION/mission.dat")
    assert struct.unpack_from("<HHHHH", content) == (0x763D, 0, 0, 0, 2)
    x = [m.x for m in unpack_mission(0, content).items]  # type: ignore[union-attr]
    assert x == [473_970_000, 473_970_001]
    three = struct.pack("<HHHHH", 0x763D, 0, 0, 0, 3) + content[10:] + content[-38:]
    assert upload(client, b"@MISSION/mission.dat", three) == Opcode.ACK
    assert [m.x for m in vehicle.missions[0]] == [*x, x[1]]
    assert vehicle.missions[0][0].get_type() == "MISSION_ITEM_INT"
    for wrong in (three[:-1], three[:-38] + bytes(38), b"\0" + three[1:], three[:2] + b"\1" + three[3:]):
        assert upload(client, b"@MISSION/mission.dat", wrong) == Opcode.NAK
    assert len(vehicle.missions[0]) == 3


def names(files: FileSystem, path: str) -> list[str]:
    return [entry.name for entry in files.entries(path)]


def test_the_file_tree_of_ardupilot() -> None:
    files = Vehicle().files
    assert names(files, "/") == ["@MISSION", "@PARAM", "@SYS", "APM"]
    assert names(files, "@MISSION") == ["fence.dat", "mission.dat", "rally.dat"]
    assert files.read("@SYS/uarts.txt") == b"UARTV1\n"
    files.make_directory("APM/scripts")
    assert names(files, "/APM") == ["scripts"]


def test_the_file_tree_of_px4_has_the_metadata() -> None:
    metadata = ComponentMetadata(Component("PX4", "sim", "1.15.0"), {"A": 1})
    files = px4_files(metadata=lambda: metadata, recorder=FlightRecorder(DataFlashLog, LogLimits()))
    assert names(files, "/etc/extras") == ["component_general.json.xz", "parameters.json.xz"]
    client = FtpClient(files, ftp.PX4)
    assert client.one(Opcode.REMOVE_FILE, b"/etc/extras/parameters.json.xz").error == FtpError.FAIL_ERRNO


@pytest.mark.parametrize(
    ("utc_s", "name"),
    [
        (0, "1970-01-01/00_00_00.ulg"),
        (1_735_689_599, "2024-12-31/23_59_59.ulg"),
    ],
)
def test_logs_of_px4_are_named_by_date_and_time(utc_s: float, name: str) -> None:
    assert px4_log_name(StoredLog(1, utc_s, utc_s, bytearray())) == name
