"""Component information: metadata files for ground stations."""

import json
import lzma
import struct
from typing import Any

from sim_vehicle.conformance import frames, parameters
from sim_vehicle.conformance.assertions import CheckFailed, Skip, equal, holds
from sim_vehicle.conformance.checks.files import bare_crc32
from sim_vehicle.conformance.ftp import FtpClient
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

METADATA = struct.Struct("<II100s")  # COMPONENT_METADATA on the wire: time_boot_ms, file_crc, uri
PARAMETER_METADATA = 1  # COMP_METADATA_TYPE_PARAMETER
SCHEME = "mftp://"


def _metadata(vehicle: VehicleUnderTest) -> tuple[int, str]:
    """Return checksum and URI of the general metadata file."""
    _, crc, uri = vehicle.request_fields(frames.COMPONENT_METADATA, METADATA)
    return crc, uri.rstrip(b"\0").decode("ascii", "replace")


def _path(uri: str) -> str:
    """Return the path in an FTP URI, without the component id; raise Skip for another URI."""
    if not uri.startswith(SCHEME):
        raise Skip(f"the file {uri} is not on the vehicle")
    path = uri.removeprefix(SCHEME)
    if path.startswith("["):
        path = path.partition("]")[2]
    return "/" + path.lstrip("/")


def _fetch(vehicle: VehicleUnderTest, uri: str) -> tuple[bytes, Any]:
    """Return the stored bytes of a file, and its JSON content."""
    data = FtpClient(vehicle).burst(_path(uri))
    return data, json.loads(lzma.decompress(data) if uri.endswith(".xz") else data)


@check("component.metadata_is_announced")
def metadata_is_announced(vehicle: VehicleUnderTest) -> str:
    """COMPONENT_METADATA names a file."""
    _, uri = _metadata(vehicle)
    holds(bool(uri), "the URI is empty")
    return uri


@check(
    "component.general_file_is_valid",
    limit_s=120,
    source="PX4 generate_crc.py: the checksum of the file before its compression",
)
def general_file(vehicle: VehicleUnderTest) -> str:
    """The general file, before its compression, has the announced checksum, and lists metadata by type."""
    crc, uri = _metadata(vehicle)
    data, content = _fetch(vehicle, uri)
    equal(bare_crc32(lzma.decompress(data) if uri.endswith(".xz") else data), crc, "checksum")
    entries = content.get("metadataTypes")
    if not isinstance(entries, list) or not entries:
        raise CheckFailed(f"metadataTypes: expected a list with entries, saw {entries!r:.80}")
    types = [entry["type"] for entry in entries]
    return f"types {types}"


@check("component.parameter_file_is_valid", limit_s=180)
def parameter_file(vehicle: VehicleUnderTest) -> str:
    """The parameter file describes at least 90 % of the vehicle's parameters."""
    _, uri = _metadata(vehicle)
    _, general = _fetch(vehicle, uri)
    found = [e for e in general["metadataTypes"] if e["type"] == PARAMETER_METADATA]
    if not found:
        raise Skip("no parameter metadata is listed")
    data, content = _fetch(vehicle, found[0]["uri"])
    if "fileCrc" in found[0]:
        equal(bare_crc32(data), found[0]["fileCrc"], "checksum")
    names = {entry["name"] for entry in content["parameters"]}
    listed = set(parameters.listed(vehicle))
    holds(
        len(names & listed) >= 0.9 * len(listed),
        f"{len(listed - names)} of {len(listed)} parameters are missing in the file",
    )
    return f"{len(names)} parameters"
