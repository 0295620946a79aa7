"""Geofence of a vehicle: one inclusion polygon, as a mission of type fence.

https://mavlink.io/en/services/mission.html#mission_types and MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION:
every vertex carries the number of vertices. The read-back may have another frame, and has no altitude.
"""

from __future__ import annotations

from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.geo import LatLon
from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.procedures.guarded import UNTIL_REPLACED_S, command, send_acknowledged
from swarmctl.mavlink.procedures.verified_upload import UPLOAD_TRIES, read_back, upload_verified
from swarmctl.mavlink.protocol.mission_download import DownloadResult
from swarmctl.mavlink.protocol.mission_upload import Upload
from swarmctl.mavlink.protocol.outcome import Done
from swarmctl.mavlink.protocol.procedure import Context, Procedure

FENCE = int(mavlink.MAV_MISSION_TYPE_FENCE)
MAX_VERTICES = 60
"""limit below the capacity of ArduCopter's storage, about 70 vertices"""

_VERTEX = int(mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION)


def fence_items(polygon: Sequence[LatLon]) -> tuple[MissionItem, ...]:
    """Return the mission items of a polygon [deg]. Raises ValueError for too few or too many vertices."""
    if not 3 <= len(polygon) <= MAX_VERTICES:
        raise ValueError(f"a fence of {len(polygon)} vertices: expected 3 to {MAX_VERTICES}")
    frame = int(mavlink.MAV_FRAME_GLOBAL)
    return tuple(
        MissionItem(
            _VERTEX, frame, round(lat_deg * 1e7), round(lon_deg * 1e7), 0.0, param1=float(len(polygon))
        )
        for lat_deg, lon_deg in polygon
    )


def fence_differences(sent: Sequence[MissionItem], found: Sequence[MissionItem]) -> tuple[str, ...]:
    """Return the differences between a fence and its read-back; empty for equal vertices in equal order."""
    if len(sent) != len(found):
        return (f"{len(found)} items instead of {len(sent)}",)
    return tuple(
        f"vertex {seq}: sent {_vertex_text(a)}, found {_vertex_text(b)}"
        for seq, (a, b) in enumerate(zip(sent, found, strict=True))
        if _compared_fields(a) != _compared_fields(b)
    )


def _compared_fields(item: MissionItem) -> tuple[int, float, int, int]:
    return item.command, item.param1, item.x, item.y


def _vertex_text(item: MissionItem) -> str:
    command_text = "" if item.command == _VERTEX else f", command {item.command}"
    return f"({item.x / 1e7:.7f}, {item.y / 1e7:.7f}){command_text}, {item.param1:g} vertices"


def put_fence(ctx: Context, items: tuple[MissionItem, ...]) -> Procedure[Done]:
    """Upload a fence to a disarmed vehicle, read it back and compare; try again after curable failures."""
    if ctx.state.armed:
        return Done("the vehicle is armed; change its fence while it is disarmed on the ground [armed]")

    def upload() -> Upload:
        return Upload(ctx.peer, items, FENCE)

    def differences(found: tuple[MissionItem, ...]) -> tuple[str, ...]:
        return fence_differences(items, found)

    uploaded = yield from upload_verified(ctx, upload, differences, UPLOAD_TRIES)
    return Done(uploaded.failure)


def enable_fence(ctx: Context) -> Procedure[Done]:
    """Enable the fences of FENCE_TYPE on a disarmed ArduPilot.

    Since 4.6 ArduPilot reads FENCE_TYPE at boot and when FENCE_ENABLE changes. A fence that a command has
    switched off stays off, so parameters do not show the enabled fences (`AC_Fence::update`,
    `AC_Fence::enable`). ArduPilot acknowledges the command after the change.
    """
    if ctx.state.armed:
        return Done("the vehicle is armed; enable its fence while it is disarmed on the ground [armed]")
    order = command(ctx, mavlink.MAV_CMD_DO_FENCE_ENABLE, (1.0,), lasts_s=UNTIL_REPLACED_S)
    return Done((yield from send_acknowledged(ctx, order)))


def read_fence(ctx: Context) -> Procedure[DownloadResult]:
    """Return the fence that is stored on the vehicle."""
    return (yield from read_back(ctx, mission_type=FENCE))
