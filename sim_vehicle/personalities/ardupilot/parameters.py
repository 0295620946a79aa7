"""Parameters of ArduCopter and ArduPlane 4.6, with their names, units and defaults.

Parameters marked "no effect" and those of `setup_parameters` exist for ground stations that read them. The
firmware has the same integer parameters. ArduPilot sends all values as floats.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.ardupilot import setup_parameters

_COMMON: dict[str, float | int] = {
    "ARMING_CHECK": 1,  # 0: mandatory checks only
    "BATT_CAPACITY": 3300,  # mAh
    "BATT_CRT_MAH": 0.0,  # remaining mAh, 0: not watched
    "BATT_CRT_VOLT": 0.0,  # V, 0: not watched
    "BATT_FS_CRT_ACT": 0,
    "BATT_FS_LOW_ACT": 0,
    "BATT_LOW_MAH": 0.0,  # remaining mAh, 0: not watched
    "BATT_LOW_TIMER": 10,  # s of low voltage before the failsafe
    "BATT_LOW_VOLT": 10.5,  # V, 0: not watched
    "BATT_MONITOR": 4,  # no effect
    "FENCE_ALT_MAX": 100.0,  # m above home
    "FENCE_ALT_MIN": -10.0,  # m above home
    "FENCE_ENABLE": 0,
    "FENCE_MARGIN": 2.0,  # m
    "FENCE_RADIUS": 300.0,  # m around home
    "FENCE_TOTAL": 0,  # stored points
    "LOG_BACKEND_TYPE": 1,
    "LOG_DISARMED": 0,
    "MIS_RESTART": 0,  # 1: AUTO starts at the beginning
    "MIS_TOTAL": 0,  # stored commands
    "RALLY_TOTAL": 0,
    "RC_OVERRIDE_TIME": 3.0,  # s, 0: overrides have no effect, -1: no end
    "SIM_BATT_VOLTAGE": 12.6,  # V, full and at rest
    "SIM_ENGINE_FAIL": 0,  # bits of the failing motors
    "SIM_ENGINE_MUL": 1.0,  # remaining thrust of the failing motors, as a share
    "SIM_GPS_DISABLE": 0,
    "SIM_GPS_GLITCH_X": 0.0,  # deg of latitude
    "SIM_GPS_GLITCH_Y": 0.0,  # deg of longitude
    "SIM_GPS_GLITCH_Z": 0.0,  # m
    "SIM_RC_FAIL": 0,  # 1: no pulses
    "SIM_WIND_DIR": 180.0,  # deg from which the wind blows
    "SIM_WIND_SPD": 0.0,  # m/s, 0: the scenario's wind
    "SYSID_ENFORCE": 0,  # 1: only messages of SYSID_MYGCS are processed
    "SYSID_MYGCS": 255,
    "SYSID_THISMAV": 1,
}

_COPTER_BASE, _PLANE_BASE = setup_parameters.COPTER | _COMMON, setup_parameters.PLANE | _COMMON
COPTER: dict[str, float | int] = _COPTER_BASE | {
    "ANGLE_MAX": 3000,  # cdeg
    "ATC_SLEW_YAW": 6000.0,  # cdeg/s
    "AUTO_OPTIONS": 0,  # bit 0: AUTO can be armed; bit 1: take-off without raising the throttle
    "DISARM_DELAY": 10,  # s, 0 never
    "FENCE_ACTION": 1,  # 0 report, 1 RTL or land, 2 land, 3 as 1, 4 brake or land, 5 as 1
    "FENCE_TYPE": 7,  # bits: 0 maximum altitude, 1 circle, 2 polygons, 3 minimum altitude
    "FORMAT_VERSION": 120,  # no effect
    "FRAME_CLASS": 1,  # no effect
    "FRAME_TYPE": 0,  # no effect
    "FS_EKF_ACTION": 1,  # 0 report, 1 land, 2 altitude hold, 3 land even in stabilize
    "FS_EKF_THRESH": 0.8,  # limit of the variances, 0: not watched
    "FS_GCS_ENABLE": 0,  # 0 nothing, 1 RTL, 2 and 3 as 1, 4 and 5 land, 6 as 1, 7 brake or land
    "FS_GCS_TIMEOUT": 5.0,  # s
    # bits of modes that continue; RC lost: 0 AUTO, 2 GUIDED; GCS lost: 1 AUTO, 4 pilot's modes
    "FS_OPTIONS": 16,
    "FS_THR_ENABLE": 1,  # 0 nothing, 1 RTL, 2 as 1, 3 land, 4 as 1, 5 land, 6 as 1, 7 brake or land
    "GUID_TIMEOUT": 3.0,  # s after which a set-point of velocity or attitude ends
    "LAND_ALT_LOW": 1000,  # cm above home, below which LAND_SPEED applies
    "LAND_SPEED": 50,  # cm/s
    "LAND_SPEED_HIGH": 0,  # cm/s, 0: WPNAV_SPEED_DN
    "LOIT_ACC_MAX": 500.0,  # cm/s/s
    "LOIT_SPEED": 1250.0,  # cm/s
    "PILOT_ACCEL_Z": 250,  # cm/s/s
    "PILOT_SPEED_DN": 0,  # cm/s, 0: PILOT_SPEED_UP
    "PILOT_SPEED_UP": 250,  # cm/s
    "PILOT_Y_RATE": 202.5,  # deg/s
    "RALLY_INCL_HOME": 1,  # 0: home only if no rally point is in range
    "RALLY_LIMIT_KM": 0.3,  # km, 0: no limit
    "PSC_JERK_XY": 5.0,  # m/s/s/s of a flight by set-points
    "PSC_JERK_Z": 5.0,  # m/s/s/s
    "RC_FS_TIMEOUT": 1.0,  # s without a frame until the remote control counts as lost
    "RTL_ALT": 1500,  # cm above home
    "RTL_ALT_FINAL": 0,  # cm above home, hover height at the end of a return; 0: landing
    "RTL_CLIMB_MIN": 0,  # cm
    "RTL_CONE_SLOPE": 3.0,  # largest ratio of return height to distance from home; below 0.5: no limit
    "RTL_LOIT_TIME": 5000,  # ms
    "RTL_SPEED": 0,  # cm/s, 0: WPNAV_SPEED
    "THR_DZ": 100,  # share of the throttle on each side of its middle [0.1 %]
    "WPNAV_ACCEL": 250.0,  # cm/s/s
    "WPNAV_ACCEL_Z": 100.0,  # cm/s/s
    "WPNAV_JERK": 1.0,  # m/s/s/s of the legs of a mission
    "WPNAV_RADIUS": 200.0,  # cm
    "WPNAV_SPEED": 1000.0,  # cm/s
    "WPNAV_SPEED_DN": 150.0,  # cm/s
    "WPNAV_SPEED_UP": 250.0,  # cm/s
}

PLANE: dict[str, float | int] = _PLANE_BASE | {
    "AIRSPEED_CRUISE": 15.0,  # m/s
    "AIRSPEED_MAX": 22,  # m/s
    "AIRSPEED_MIN": 9,  # m/s
    "AIRSPEED_STALL": 0.0,  # m/s, 0: 8 m/s
    "BATT_LOW_VOLT": 0.0,  # V, 0: not watched
    "FBWB_CLIMB_RATE": 2,  # m/s
    "FENCE_ACTION": 1,  # 0 report, 1 RTL, 6 guided, 7 guided with throttle pass-through, 8 AUTOLAND or RTL
    "FENCE_RET_ALT": 0,  # m above home in guided after a breach, 0: half way from floor to ceiling
    "FENCE_TYPE": 4,  # bits as for the copter
    "FORMAT_VERSION": 13,  # no effect
    "FS_GCS_ENABL": 0,  # 0 nothing, 1 heartbeats
    # 0 AUTO and GUIDED continue, other modes RTL; 1 RTL, 2 glide, 3 report, 4 AUTO, 5 AUTOLAND or RTL
    "FS_LONG_ACTN": 0,
    "FS_LONG_TIMEOUT": 5.0,  # s
    # 0 AUTO, GUIDED and LOITER continue, other modes CIRCLE; 1 CIRCLE, 2 glide, 3 none, 4 FBWB.
    # CIRCLE, RTL and TAKEOFF always continue.
    "FS_SHORT_ACTN": 0,
    "LAND_FLARE_SEC": 2.0,  # s, no effect
    "LAND_DISARMDELAY": 20,  # s, 0 never
    "PTCH_LIM_MAX_DEG": 20.0,
    "PTCH_LIM_MIN_DEG": -25.0,
    "Q_ENABLE": 0,  # no effect: no simulated plane hovers
    "RALLY_INCL_HOME": 0,  # 0: home only if no rally point is in range
    "RALLY_LIMIT_KM": 5.0,  # km, 0: no limit
    "ROLL_LIMIT_DEG": 45.0,  # deg
    "RTL_ALTITUDE": 100.0,  # m above home, -1: the present altitude
    "RTL_AUTOLAND": 0,  # landing of RTL by the mission's DO_LAND_START: 0 never, 1 from home, 2 at once
    "RTL_RADIUS": 0,  # m, negative: counter-clockwise; 0: WP_LOITER_RAD
    "TECS_CLMB_MAX": 5.0,  # m/s
    "TECS_SINK_MAX": 5.0,  # m/s
    "THR_FAILSAFE": 1,
    "TKOFF_ALT": 50,  # m
    "WP_LOITER_RAD": 60,  # m, negative: counter-clockwise
    "WP_MAX_RADIUS": 0,  # m, no effect: a plane passes a waypoint without circling
    "WP_RADIUS": 90,  # m
}

# Width of the integer parameters [bits].
_INT8 = (
    "BATT_FS_CRT_ACT BATT_FS_LOW_ACT BATT_LOW_TIMER BATT_MONITOR DISARM_DELAY FBWB_CLIMB_RATE FENCE_ACTION"
    " FENCE_ENABLE FENCE_TOTAL FENCE_TYPE FRAME_CLASS FRAME_TYPE FS_EKF_ACTION FS_GCS_ENABL FS_GCS_ENABLE"
    " FS_LONG_ACTN FS_SHORT_ACTN FS_THR_ENABLE LAND_DISARMDELAY LOG_BACKEND_TYPE LOG_DISARMED MIS_RESTART"
    " Q_ENABLE RALLY_INCL_HOME RALLY_TOTAL RTL_AUTOLAND SIM_ENGINE_FAIL SIM_GPS_DISABLE SIM_RC_FAIL"
    " SYSID_ENFORCE THR_FAILSAFE"
)
_INT16 = (
    "AIRSPEED_MAX AIRSPEED_MIN FENCE_RET_ALT FORMAT_VERSION LAND_ALT_LOW LAND_SPEED LAND_SPEED_HIGH MIS_TOTAL"
    " PILOT_SPEED_DN PILOT_SPEED_UP RTL_ALT_FINAL RTL_CLIMB_MIN RTL_RADIUS RTL_SPEED SYSID_MYGCS"
    " ANGLE_MAX PILOT_ACCEL_Z SYSID_THISMAV THR_DZ TKOFF_ALT WP_LOITER_RAD WP_MAX_RADIUS WP_RADIUS"
)
_INT32 = "ARMING_CHECK AUTO_OPTIONS BATT_CAPACITY FS_OPTIONS RTL_ALT RTL_LOIT_TIME"
BITS: dict[str, int] = setup_parameters.BITS | {
    name: bits for bits, names in ((8, _INT8), (16, _INT16), (32, _INT32)) for name in names.split()
}

# Counter of stored items for each MAV_MISSION_TYPE.
TOTALS = {
    mavlink.MAV_MISSION_TYPE_MISSION: "MIS_TOTAL",
    mavlink.MAV_MISSION_TYPE_FENCE: "FENCE_TOTAL",
    mavlink.MAV_MISSION_TYPE_RALLY: "RALLY_TOTAL",
}
READ_ONLY = frozenset({"SYSID_THISMAV", "FORMAT_VERSION", "Q_ENABLE", "WP_MAX_RADIUS", *TOTALS.values()})
