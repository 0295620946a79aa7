"""Component metadata: the messages on the wire and the files they name."""

import json
import lzma
import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from sim_vehicle.definitions import (
    COMPONENT_INFORMATION,
    COMPONENT_INFORMATION_BASIC,
    COMPONENT_METADATA,
    Layout,
)
from sim_vehicle.files.component_metadata import Component, ComponentMetadata

PARAMETERS = {"MIS_TAKEOFF_ALT": 2.5, "NAV_RCL_ACT": 2}
METADATA = ComponentMetadata(Component("PX4", "SITL", "1.15.2", capabilities=0xE0EF), PARAMETERS)
# Messages of the common dialect: id -> CRC extra, bytes of the payload.
KNOWN = {395: (0, 212), 396: (50, 160), 397: (182, 108)}


def payload(layout: Layout) -> bytes:
    """Return the payload of a frame, with its trailing zeros; check its checksum."""
    message_id = layout.message_id
    frame = METADATA.message(layout, 1234).pack(mavlink.MAVLink(None, srcSystem=3, srcComponent=1))
    crc_extra, size = KNOWN[message_id]
    length = frame[1]
    assert int.from_bytes(frame[7:10], "little") == message_id
    assert len(frame) == 12 + length
    crc = x25crc(frame[1:-2])
    crc.accumulate([crc_extra])
    assert frame[-2:] == struct.pack("<H", crc.crc)
    return bytes(frame[10:-2].ljust(size, b"\0"))


def test_component_information_names_the_same_file_and_no_peripherals() -> None:
    _, crc, no_crc, uri, none = struct.unpack("<III100s100s", payload(COMPONENT_INFORMATION))
    assert struct.unpack("<II100s", payload(COMPONENT_METADATA))[1:] == (crc, uri)
    assert (no_crc, none) == (0, bytes(100))


def test_component_information_basic_has_the_identity() -> None:
    fields = struct.unpack("<QII32s32s24s24s32s", payload(COMPONENT_INFORMATION_BASIC))
    assert fields[:3] == (0xE0EF, 1234, 0)
    assert [text.rstrip(b"\0") for text in fields[3:]] == [b"PX4", b"SITL", b"1.15.2", b"", b""]


def unpacked(path: str) -> dict:  # type: ignore[type-arg]
    content = lzma.LZMADecompressor(format=lzma.FORMAT_XZ)
    text = content.decompress(METADATA.files[path])
    assert content.check == lzma.CHECK_CRC32
    loaded: dict = json.loads(text)  # type: ignore[type-arg]
    return loaded


def test_each_parameter_is_described() -> None:
    file = unpacked("etc/extras/parameters.json.xz")
    assert file["version"] >= 3
    assert file["parameters"] == [
        {"name": "MIS_TAKEOFF_ALT", "type": "Float", "default": 2.5, "group": "MIS"},
        {"name": "NAV_RCL_ACT", "type": "Int32", "default": 2, "group": "NAV"},
    ]
