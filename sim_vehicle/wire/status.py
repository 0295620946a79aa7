"""State of the autopilots as arrays over the fleet: the columns of telemetry without physics."""

from typing import Any

import numpy as np
import numpy.typing as npt


class Status:
    """Columns over n vehicles; `publish.publish` writes most columns of a vehicle's row."""

    def __init__(self, n: int) -> None:
        def column(kind: str, value: float = 0) -> npt.NDArray[Any]:
            return np.full(n, value, dtype=kind)

        self.booted = column("?")
        self.boot_s = column("f8")
        # lead of the vehicle's own clock [s]: clock_offset_s + (now - clock_since_s) * clock_drift
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
        self.sensors = column("u4")  # present sensors
        self.sensors_enabled = column("u4")
        self.health = column("u4")
        # RC_CHANNELS
        self.rc_count = column("u1")
        self.rc_us = np.zeros((n, 18), dtype="u2")
        # state of the vehicle
        self.gps_seen = column("?")  # the first GPS fix after the boot is due
        self.position_known = column("?")
        self.armed_since_s = column("f8", np.nan)  # nan: not armed
        self.flying_since_s = column("f8", np.nan)  # latest take-off since arming; nan: none
        self.flights = column("u4")  # number of flights, counted by a parameter
        self.landed_state = column("u1")
        self.has_home = column("?")
        self.home_e7 = np.zeros((n, 2), dtype="i4")  # latitude, longitude [1e-7 deg]
        self.home_amsl_m = column("f8")
        self.home_is_local = column("?")  # HOME_POSITION includes local coordinates
        self.has_origin = column("?")
        self.origin_m = np.zeros((n, 3))  # east, north, up in the fleet's frame
        self.origin_e7 = np.zeros((n, 2), dtype="i4")  # latitude, longitude [1e-7 deg]
        # targets
        self.has_place = column("?")  # the target is a global position
        self.has_setpoint = column("?")  # the target is a position or a velocity in local coordinates
        # mission
        self.mission_seq = column("u2")
        self.mission_total = column("u2")
        self.mission_state = column("u1")
        self.mission_mode = column("u1")
        self.item_reached = column("u2")
        self.mission_ids = np.zeros((n, 3), dtype="u4")  # ids of mission, fence, rally points
        # fence
        self.fence_enabled = column("?")
        self.fence_status = column("u1")
        self.fence_breaches = column("u2")
        self.fence_type = column("u1")
        self.fence_time_ms = column("u4")
        # battery, threats
        self.battery_state = column("u1")  # MAV_BATTERY_CHARGE_STATE
        self.threatened = column("?")  # hostiles can strike
        self.strikes = column("i4")
