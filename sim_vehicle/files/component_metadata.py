"""Component metadata: the files, and the messages with their URIs.

The general file has the URI and checksum of the parameter file. Both are xz files with a CRC-32, which small
decoders support.
"""

import json
import lzma
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from sim_vehicle.files.ftp import checksum

PARAMETER_TYPE = 1  # COMP_METADATA_TYPE_PARAMETER
COMPONENT_INFORMATION = 395
COMPONENT_INFORMATION_BASIC = 396
COMPONENT_METADATA = 397

# Messages missing in pymavlink: id -> name, and fields in wire order (type, name, array length or 0).
_MESSAGES: Mapping[int, tuple[str, tuple[tuple[str, str, int], ...]]] = {
    COMPONENT_INFORMATION: (
        "COMPONENT_INFORMATION",
        (
            ("uint32_t", "time_boot_ms", 0),
            ("uint32_t", "general_metadata_file_crc", 0),
            ("uint32_t", "peripherals_metadata_file_crc", 0),
            ("char", "general_metadata_uri", 100),
            ("char", "peripherals_metadata_uri", 100),
        ),
    ),
    COMPONENT_INFORMATION_BASIC: (
        "COMPONENT_INFORMATION_BASIC",
        (
            ("uint64_t", "capabilities", 0),
            ("uint32_t", "time_boot_ms", 0),
            ("uint32_t", "time_manufacture_s", 0),
            ("char", "vendor_name", 32),
            ("char", "model_name", 32),
            ("char", "software_version", 24),
            ("char", "hardware_version", 24),
            ("char", "serial_number", 32),
        ),
    ),
    COMPONENT_METADATA: (
        "COMPONENT_METADATA",
        (("uint32_t", "time_boot_ms", 0), ("uint32_t", "file_crc", 0), ("char", "uri", 100)),
    ),
}
_BYTES = {"uint32_t": 4, "uint64_t": 8}


@cache
def crc_extra(message_id: int) -> int:
    """Return CRC_EXTRA of a message, computed from `_MESSAGES`."""
    name, fields = _MESSAGES[message_id]
    crc = x25crc()
    crc.accumulate_str(f"{name} ")
    for kind, field, length in fields:
        crc.accumulate_str(f"{kind} {field} ")
        if length:
            crc.accumulate([length])
    return int((crc.crc & 0xFF) ^ (crc.crc >> 8))


class ComponentMessage(mavlink.MAVLink_message):  # type: ignore[misc]
    """A message of `_MESSAGES`, packed like the messages of pymavlink."""

    def __init__(self, message_id: int, **values: int | str) -> None:
        name, fields = _MESSAGES[message_id]
        super().__init__(message_id, name)
        self._fieldnames = [field for _, field, _ in fields]
        self._fields = fields
        for field, value in values.items():
            setattr(self, field, value)

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        payload = b""
        for kind, field, length in self._fields:
            value = getattr(self, field)
            if length:
                payload += value.encode()[: length - 1].ljust(length, b"\0")
            else:
                payload += value.to_bytes(_BYTES[kind], "little")
        return bytes(self._pack(mav, crc_extra(self.get_msgId()), payload, force_mavlink1=force_mavlink1))


@dataclass(frozen=True, slots=True)
class ParameterMeta:
    """The metadata of one parameter; without a group, its group is the name up to the first `_`."""

    name: str
    default: float | int  # an int means an integer parameter; inf or NaN: no default
    short: str = ""  # short description
    units: str = ""
    group: str = ""
    read_only: bool = False
    reboot_required: bool = False


@dataclass(frozen=True, slots=True)
class Component:
    """The identity of a component; `capabilities` are MAV_PROTOCOL_CAPABILITY bits."""

    vendor: str
    model: str
    version: str  # `major.minor.patch`
    capabilities: int = 0


class ComponentMetadata:
    """The metadata files (by path, without a leading `/`) and messages of all vehicles of one kind."""

    def __init__(
        self, component: Component, parameters: Iterable[ParameterMeta], *, directory: str = "/etc/extras"
    ) -> None:
        self._component = component
        parameter_path = f"{directory}/parameters.json.xz"
        parameter_file = _compressed(_json({"version": 3, "parameters": [_described(p) for p in parameters]}))
        self._general_path = f"{directory}/component_general.json.xz"
        general = _json(
            {
                "version": 1,
                "vendorName": component.vendor,
                "modelName": component.model,
                "firmwareVersion": component.version,
                "metadataTypes": [
                    {
                        "type": PARAMETER_TYPE,
                        "uri": f"mftp://{parameter_path}",
                        "fileCrc": checksum(parameter_file),
                    }
                ],
            }
        )
        # PX4 announces the checksum of the file before its compression (generate_crc.py).
        self._general_crc = checksum(general)
        self.files: dict[str, bytes] = {
            self._general_path.lstrip("/"): _compressed(general),
            parameter_path.lstrip("/"): parameter_file,
        }

    def message(self, message_id: int, time_boot_ms: int) -> ComponentMessage | None:
        """Return the message with this id, or None if the id is not a message of component metadata."""
        uri = f"mftp://{self._general_path}"
        crc = self._general_crc
        component = self._component
        if message_id == COMPONENT_METADATA:
            return ComponentMessage(message_id, time_boot_ms=time_boot_ms, file_crc=crc, uri=uri)
        if message_id == COMPONENT_INFORMATION:
            return ComponentMessage(
                message_id,
                time_boot_ms=time_boot_ms,
                general_metadata_file_crc=crc,
                peripherals_metadata_file_crc=0,
                general_metadata_uri=uri,
                peripherals_metadata_uri="",
            )
        if message_id == COMPONENT_INFORMATION_BASIC:
            return ComponentMessage(
                message_id,
                capabilities=component.capabilities,
                time_boot_ms=time_boot_ms,
                time_manufacture_s=0,
                vendor_name=component.vendor,
                model_name=component.model,
                software_version=component.version,
                hardware_version="",
                serial_number="",
            )
        return None


def _described(parameter: ParameterMeta) -> dict[str, Any]:
    described: dict[str, Any] = {
        "name": parameter.name,
        "type": "Int32" if isinstance(parameter.default, int) else "Float",
    }
    if math.isfinite(parameter.default):
        described["default"] = parameter.default
    for key, text in (
        ("shortDesc", parameter.short),
        ("units", parameter.units),
        ("group", parameter.group or parameter.name.split("_")[0]),
    ):
        if text:
            described[key] = text
    if parameter.read_only:
        described["readOnly"] = True
    if parameter.reboot_required:
        described["rebootRequired"] = True
    return described


def _json(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, separators=(",", ":"), allow_nan=False).encode()


def _compressed(content: bytes) -> bytes:
    return lzma.compress(content, format=lzma.FORMAT_XZ, check=lzma.CHECK_CRC32, preset=1)
