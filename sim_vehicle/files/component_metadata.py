"""Component metadata: the files, and the messages with their URIs.

The general file has the URI and checksum of the parameter file. Both are xz files with a CRC-32, which small
decoders support.
"""

import json
import lzma
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sim_vehicle.definitions import (
    COMPONENT_INFORMATION,
    COMPONENT_INFORMATION_BASIC,
    COMPONENT_METADATA,
    DefinedMessage,
    Layout,
)
from sim_vehicle.files.ftp import checksum

DIRECTORY = "/etc/extras"
PARAMETER_TYPE = 1  # COMP_METADATA_TYPE_PARAMETER


@dataclass(frozen=True, slots=True)
class Component:
    """The identity of a component; `capabilities` are MAV_PROTOCOL_CAPABILITY bits."""

    vendor: str
    model: str
    version: str  # `major.minor.patch`
    capabilities: int = 0


class ComponentMetadata:
    """The metadata files (by path, without a leading `/`) and messages of all vehicles of one kind.

    parameters: default of each parameter by name; an int means an integer parameter.
    """

    def __init__(self, component: Component, parameters: Mapping[str, float | int]) -> None:
        self._component = component
        described = [_described(name, default) for name, default in sorted(parameters.items())]
        parameter_path = f"{DIRECTORY}/parameters.json.xz"
        parameter_file = _compressed(_json({"version": 3, "parameters": described}))
        self._general_path = f"{DIRECTORY}/component_general.json.xz"
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

    def message(self, layout: Layout, time_boot_ms: int) -> DefinedMessage:
        """Return COMPONENT_METADATA, COMPONENT_INFORMATION or COMPONENT_INFORMATION_BASIC."""
        uri, component = f"mftp://{self._general_path}".encode(), self._component
        values: dict[int, dict[str, Any]] = {
            COMPONENT_METADATA.message_id: {"file_crc": self._general_crc, "uri": uri},
            COMPONENT_INFORMATION.message_id: {
                "general_metadata_file_crc": self._general_crc,
                "general_metadata_uri": uri,
            },
            COMPONENT_INFORMATION_BASIC.message_id: {
                "capabilities": component.capabilities,
                "vendor_name": component.vendor.encode(),
                "model_name": component.model.encode(),
                "software_version": component.version.encode(),
            },
        }
        return DefinedMessage(layout, time_boot_ms=time_boot_ms, **values[layout.message_id])


def _described(name: str, default: float | int) -> dict[str, Any]:
    """Return the entry of a parameter; its group is the name up to the first `_`."""
    kind = "Int32" if isinstance(default, int) else "Float"
    return {"name": name, "type": kind, "default": default, "group": name.split("_", maxsplit=1)[0]}


def _json(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, separators=(",", ":"), allow_nan=False).encode()


def _compressed(content: bytes) -> bytes:
    return lzma.compress(content, format=lzma.FORMAT_XZ, check=lzma.CHECK_CRC32, preset=1)
