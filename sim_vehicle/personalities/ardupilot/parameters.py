"""Parameters of ArduCopter and ArduPlane 4.6, with their names, units and defaults.

Parameters marked "no effect" and those of `setup_parameters` exist for ground stations that read them. The
firmware has the same integer parameters. ArduPilot sends all values as floats.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.ardupilot import setup_parameters

# name, type, value of ArduCopter, value of ArduPlane (-: no such parameter), unit and meaning; the meaning
# can go on in indented lines
_ROWS = """
ARMING_CHECK      int32       1       1  0: mandatory checks only
BATT_CAPACITY     int32    3300    3300  mAh
BATT_CRT_MAH      float     0.0     0.0  remaining mAh, 0: not watched
BATT_CRT_VOLT     float     0.0     0.0  V, 0: not watched
BATT_FS_CRT_ACT   int8        0       0
BATT_FS_LOW_ACT   int8        0       0
BATT_LOW_MAH      float     0.0     0.0  remaining mAh, 0: not watched
BATT_LOW_TIMER    int8       10      10  s of low voltage before the failsafe
BATT_LOW_VOLT     float    10.5     0.0  V, 0: not watched
BATT_MONITOR      int8        4       4  no effect
FENCE_ALT_MAX     float   100.0   100.0  m above home
FENCE_ALT_MIN     float   -10.0   -10.0  m above home
FENCE_ENABLE      int8        0       0
FENCE_MARGIN      float     2.0     2.0  m
FENCE_RADIUS      float   300.0   300.0  m around home
FENCE_TOTAL       int8        0       0  stored points
LOG_BACKEND_TYPE  int8        1       1
LOG_DISARMED      int8        0       0
MIS_RESTART       int8        0       0  1: AUTO starts at the beginning
MIS_TOTAL         int16       0       0  stored commands
RALLY_TOTAL       int8        0       0
RC_OVERRIDE_TIME  float     3.0     3.0  s, 0: overrides have no effect, -1: no end
SIM_BATT_VOLTAGE  float    12.6    12.6  V, full and at rest
SIM_ENGINE_FAIL   int8        0       0  bits of the failing motors
SIM_ENGINE_MUL    float     1.0     1.0  remaining thrust of the failing motors, as a share
SIM_GPS_DISABLE   int8        0       0
SIM_GPS_GLITCH_X  float     0.0     0.0  deg of latitude
SIM_GPS_GLITCH_Y  float     0.0     0.0  deg of longitude
SIM_GPS_GLITCH_Z  float     0.0     0.0  m
SIM_RC_FAIL       int8        0       0  1: no pulses
SIM_WIND_DIR      float   180.0   180.0  deg from which the wind blows
SIM_WIND_SPD      float     0.0     0.0  m/s, 0: the scenario's wind
SYSID_ENFORCE     int8        0       0  1: only messages of SYSID_MYGCS are processed
SYSID_MYGCS       int16     255     255
SYSID_THISMAV     int16       1       1
ANGLE_MAX         int16    3000       -  cdeg
ATC_SLEW_YAW      float  6000.0       -  cdeg/s
AUTO_OPTIONS      int32       0       -  bit 0: AUTO can be armed; bit 1: take-off without raising the
                                         throttle
DISARM_DELAY      int8       10       -  s, 0 never
FENCE_ACTION      int8        1       -  0 report, 1 RTL or land, 2 land, 3 as 1, 4 brake or land, 5 as 1
FENCE_TYPE        int8        7       -  bits: 0 maximum altitude, 1 circle, 2 polygons, 3 minimum altitude
FORMAT_VERSION    int16     120      13  no effect
FRAME_CLASS       int8        1       -  no effect
FRAME_TYPE        int8        0       -  no effect
FS_EKF_ACTION     int8        1       -  0 report, 1 land, 2 altitude hold, 3 land even in stabilize
FS_EKF_THRESH     float     0.8       -  limit of the variances, 0: not watched
FS_GCS_ENABLE     int8        0       -  0 nothing, 1 RTL, 2 and 3 as 1, 4 and 5 land, 6 as 1, 7 brake or land
FS_GCS_TIMEOUT    float     5.0       -  s
FS_OPTIONS        int32      16       -  bits of modes that continue; RC lost: 0 AUTO, 2 GUIDED; GCS lost: 1
                                         AUTO, 4 pilot's modes
FS_THR_ENABLE     int8        1       -  0 nothing, 1 RTL, 2 as 1, 3 land, 4 as 1, 5 land, 6 as 1, 7 brake or
                                         land
GUID_TIMEOUT      float     3.0       -  s after which a set-point of velocity or attitude ends
LAND_ALT_LOW      int16    1000       -  cm above home, below which LAND_SPEED applies
LAND_SPEED        int16      50       -  cm/s
LAND_SPEED_HIGH   int16       0       -  cm/s, 0: WPNAV_SPEED_DN
LOIT_ACC_MAX      float   500.0       -  cm/s/s
LOIT_SPEED        float  1250.0       -  cm/s
PILOT_ACCEL_Z     int16     250       -  cm/s/s
PILOT_SPEED_DN    int16       0       -  cm/s, 0: PILOT_SPEED_UP
PILOT_SPEED_UP    int16     250       -  cm/s
PILOT_Y_RATE      float   202.5       -  deg/s
RALLY_INCL_HOME   int8        1       0  0: home only if no rally point is in range
RALLY_LIMIT_KM    float     0.3     5.0  km, 0: no limit
PSC_JERK_XY       float     5.0       -  m/s/s/s of a flight by set-points
PSC_JERK_Z        float     5.0       -  m/s/s/s
RC_FS_TIMEOUT     float     1.0       -  s without a frame until the remote control counts as lost
RTL_ALT           int32    1500       -  cm above home
RTL_ALT_FINAL     int16       0       -  cm above home, hover height at the end of a return; 0: landing
RTL_CLIMB_MIN     int16       0       -  cm
RTL_CONE_SLOPE    float     3.0       -  largest ratio of return height to distance from home; below 0.5: no
                                         limit
RTL_LOIT_TIME     int32    5000       -  ms
RTL_SPEED         int16       0       -  cm/s, 0: WPNAV_SPEED
THR_DZ            int16     100       -  share of the throttle on each side of its middle [0.1 %]
WPNAV_ACCEL       float   250.0       -  cm/s/s
WPNAV_ACCEL_Z     float   100.0       -  cm/s/s
WPNAV_JERK        float     1.0       -  m/s/s/s of the legs of a mission
WPNAV_RADIUS      float   200.0       -  cm
WPNAV_SPEED       float  1000.0       -  cm/s
WPNAV_SPEED_DN    float   150.0       -  cm/s
WPNAV_SPEED_UP    float   250.0       -  cm/s
AIRSPEED_CRUISE   float       -    15.0  m/s
AIRSPEED_MAX      int16       -      22  m/s
AIRSPEED_MIN      int16       -       9  m/s
AIRSPEED_STALL    float       -     0.0  m/s, 0: 8 m/s
FBWB_CLIMB_RATE   int8        -       2  m/s
FENCE_ACTION      int8        -       1  0 report, 1 RTL, 6 guided, 7 guided with throttle pass-through, 8
                                         AUTOLAND or RTL
FENCE_RET_ALT     int16       -       0  m above home in guided after a breach, 0: half way from floor to
                                         ceiling
FENCE_TYPE        int8        -       4  bits as for the copter
FS_GCS_ENABL      int8        -       0  0 nothing, 1 heartbeats
FS_LONG_ACTN      int8        -       0  0 AUTO and GUIDED continue, other modes RTL; 1 RTL, 2 glide, 3
                                         report, 4 AUTO, 5 AUTOLAND or RTL
FS_LONG_TIMEOUT   float       -     5.0  s
FS_SHORT_ACTN     int8        -       0  0 AUTO, GUIDED and LOITER continue, other modes CIRCLE; 1 CIRCLE, 2
                                         glide, 3 none, 4 FBWB. CIRCLE, RTL and TAKEOFF always continue.
LAND_FLARE_SEC    float       -     2.0  s, no effect
LAND_DISARMDELAY  int8        -      20  s, 0 never
PTCH_LIM_MAX_DEG  float       -    20.0
PTCH_LIM_MIN_DEG  float       -   -25.0
Q_ENABLE          int8        -       0  no effect: no simulated plane hovers
ROLL_LIMIT_DEG    float       -    45.0  deg
RTL_ALTITUDE      float       -   100.0  m above home, -1: the present altitude
RTL_AUTOLAND      int8        -       0  landing of RTL by the mission's DO_LAND_START: 0 never, 1 from home,
                                         2 at once
RTL_RADIUS        int16       -       0  m, negative: counter-clockwise; 0: WP_LOITER_RAD
TECS_CLMB_MAX     float       -     5.0  m/s
TECS_SINK_MAX     float       -     5.0  m/s
THR_FAILSAFE      int8        -       1
TKOFF_ALT         int16       -      50  m
WP_LOITER_RAD     int16       -      60  m, negative: counter-clockwise
WP_MAX_RADIUS     int16       -       0  m, no effect: a plane passes a waypoint without circling
WP_RADIUS         int16       -      90  m
"""
_WIDTHS = {"int8": 8, "int16": 16, "int32": 32}
_CELLS = [row.split() for row in (setup_parameters.ROWS + _ROWS).splitlines() if row[:1].isalnum()]


def _column(column: int) -> dict[str, float | int]:
    """Return names and values of a column of the rows."""
    return {
        cells[0]: float(cells[column]) if cells[1] == "float" else int(cells[column])
        for cells in _CELLS
        if cells[column] != "-"
    }


COPTER, PLANE = _column(2), _column(3)
BITS = {cells[0]: _WIDTHS[cells[1]] for cells in _CELLS if cells[1] != "float"}

# Counter of stored items for each MAV_MISSION_TYPE.
TOTALS = {
    mavlink.MAV_MISSION_TYPE_MISSION: "MIS_TOTAL",
    mavlink.MAV_MISSION_TYPE_FENCE: "FENCE_TOTAL",
    mavlink.MAV_MISSION_TYPE_RALLY: "RALLY_TOTAL",
}
READ_ONLY = frozenset({"SYSID_THISMAV", "FORMAT_VERSION", "Q_ENABLE", "WP_MAX_RADIUS", *TOTALS.values()})
