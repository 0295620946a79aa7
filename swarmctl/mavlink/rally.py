"""Rally points, to which a vehicle may return instead of to where it took off, or of landing by its mission.

https://mavlink.io/en/services/mission.html#mission_types
"""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.mission_download import DownloadOutcome
from swarmctl.mavlink.placing import read_back
from swarmctl.mavlink.procedure import Context, Procedure

RALLY = int(mavlink.MAV_MISSION_TYPE_RALLY)


def see_no_rally_points(ctx: Context) -> Procedure[str | None]:
    """Why it cannot be relied on to return where it is to; None where it has no rally points."""
    read = yield from read_back(ctx, mission_type=RALLY)
    if read.outcome is not DownloadOutcome.COMPLETE:
        return f"whether it has rally points, to which it would return, is not known: {read.text}"
    if read.items:
        return f"it has {len(read.items)} rally points, to which it would return; clear them"
    return None
