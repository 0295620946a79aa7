"""ArduPilot's packed files, read by pymavlink's decoder, and the file trees."""

import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink import mavftp

from sim_vehicle.files.filesystem import FileError
from sim_vehicle.files.logs.recorder import StoredLog
from sim_vehicle.files.packed_files import Parameter, pack_parameters, unpack_mission, unpack_parameters
from sim_vehicle.personalities.px4.storage import log_name

NAMES = st.text(alphabet="ABC_12", min_size=1, max_size=16)
VALUES = st.one_of(st.integers(-(2**31), 2**31 - 1), st.floats(width=32, allow_nan=False))
FEW = [
    Parameter("ARMING_CHECK", 1, 1),
    Parameter("BATT_LOW_VOLT", 11.0, 10.5),
    Parameter("BATT_LOW_MAH", 0.0, 0.0),
    Parameter("BATT", 0, 0),
]


def made(parameters: dict[str, tuple[float, float]]) -> list[Parameter]:
    same = [(name, v, type(v)(d)) for name, (v, d) in parameters.items()]
    return [Parameter(name, value, default) for name, value, default in same]


@settings(max_examples=examples(150))
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
    data: Any = mavftp.MAVFTP.ftp_param_decode(content)
    assert {name.decode(): value for name, value, _ in data.params} == {
        name: value for name, (value, _) in parameters.items()
    }
    if defaults:
        assert {name.decode(): value for name, value, _ in data.defaults} == {
            name: default for name, (_, default) in parameters.items()
        }


@settings(max_examples=examples(60))
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


@settings(max_examples=examples(200))
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


# -- the files of a vehicle ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("utc_s", "name"), [(0, "1970-01-01/00_00_00.ulg"), (1_735_689_599, "2024-12-31/23_59_59.ulg")]
)
def test_logs_of_px4_are_named_by_date_and_time(utc_s: float, name: str) -> None:
    assert log_name(StoredLog(1, utc_s, utc_s, bytearray())) == name
