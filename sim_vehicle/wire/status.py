"""What the autopilots know and tell, as arrays over the fleet: the columns of telemetry that are not physics.

Each vehicle writes its own row (`Autopilot.publish`) when something about it has changed; telemetry reads
whole columns.
"""

from typing import Any

import numpy as np
import numpy.typing as npt


class Status:
    """Columns over n vehicles; each is written by its vehicle only."""

    def __init__(self, n: int) -> None:
        def column(kind: str, value: float = 0) -> npt.NDArray[Any]:
            return np.full(n, value, dtype=kind)

        self.booted = column("?")
        self.boot_s = column("f8")
        # the vehicle's own clock is ahead by offset + (now - since) * rate
        self.clock_offset_s = column("f8")
        self.clock_since_s = column("f8")
        self.clock_drift = column("f8")
        # HEARTBEAT
        self.autopilot = column("u1")
        self.vehicle_type = column("u1")
        self.base_mode = column("u1")
        self.custom_mode = column("u4")
        self.system_status = column("u1")
        self.standard_mode = column("u1")
        # SYS_STATUS
        self.sensors = column("u4")  # present
        self.sensors_enabled = column("u4")
        self.health = column("u4")
        # what it knows about itself
        self.gps_seen = column("?")  # its receiver has had its first fix since the boot
        self.position_known = column("?")
        self.armed_since_s = column("f8", np.nan)  # nan: not armed
        self.flying_since_s = column("f8", np.nan)  # since the take-off of this arming; nan: none yet
        self.flights = column("u4")  # a count that a parameter keeps
        self.landed_state = column("u1")
        self.has_home = column("?")
        self.home_e7 = np.zeros((n, 2), dtype="i4")
        self.home_amsl_m = column("f8")
        self.home_is_local = column("?")  # it says where home is in local coordinates, too
        self.has_origin = column("?")
        self.origin_m = np.zeros((n, 3))  # east, north, up in the fleet's frame
        self.origin_e7 = np.zeros((n, 2), dtype="i4")
        # what it tells of where it is going
        self.has_place = column("?")  # a place on earth
        self.has_setpoint = column("?")  # a position or a velocity in local coordinates
        # mission
        self.mission_seq = column("u2")
        self.mission_total = column("u2")
        self.mission_state = column("u1")
        self.mission_mode = column("u1")
        self.mission_ids = np.zeros((n, 3), dtype="u4")  # of mission, fence, rally points
        # fence
        self.fence_status = column("u1")
        self.fence_breaches = column("u2")
        self.fence_type = column("u1")
        self.fence_time_ms = column("u4")
        # the rest
        self.battery_state = column("u1")  # MAV_BATTERY_CHARGE_STATE
        self.threatened = column("?")  # there are hostiles that may strike
        self.strikes = column("i4")
        self.load = column("u2", 100)  # of the main loop [0.1 %]
