"""Parameters that ground stations read, and that have no effect on the simulated vehicle.

QGroundControl shows "setup needed" for a vehicle without calibration parameters, and pages of each ground
station need further ones. The values are those of ArduPilot 4.6.2 in SITL, whose sensors are calibrated.
"""

# name, type, value of ArduCopter, value of ArduPlane (-: no such parameter), ground station and its page
_ROWS = """
COMPASS_DEV_ID    int32        97539        97539  QGC sensors
COMPASS_DEV_ID2   int32       131874       131874  QGC sensors
COMPASS_DEV_ID3   int32       263178       263178  QGC sensors
COMPASS_USE       int8             1            1  QGC sensors
COMPASS_USE2      int8             1            1  QGC sensors
COMPASS_USE3      int8             1            1  QGC sensors
COMPASS_OFS_X     float          5.0          5.0  QGC sensors
COMPASS_OFS_Y     float         13.0         13.0  QGC sensors
COMPASS_OFS_Z     float        -18.0        -18.0  QGC sensors
COMPASS_OFS2_X    float          5.0          5.0  QGC sensors
COMPASS_OFS2_Y    float         13.0         13.0  QGC sensors
COMPASS_OFS2_Z    float        -18.0        -18.0  QGC sensors
COMPASS_OFS3_X    float          5.0          5.0  QGC sensors
COMPASS_OFS3_Y    float         13.0         13.0  QGC sensors
COMPASS_OFS3_Z    float        -18.0        -18.0  QGC sensors
INS_ACCOFFS_X     float        0.001        0.001  QGC sensors
INS_ACCOFFS_Y     float        0.001        0.001  QGC sensors
INS_ACCOFFS_Z     float        0.001        0.001  QGC sensors
COMPASS_PRIO1_ID  int32        97539        97539  QGC sensors
COMPASS_PRIO2_ID  int32       131874       131874  QGC sensors
COMPASS_PRIO3_ID  int32       263178       263178  QGC sensors
COMPASS_EXTERNAL  int8             1            1  QGC sensors
COMPASS_EXTERN2   int8             0            0  QGC sensors
COMPASS_EXTERN3   int8             0            0  QGC sensors
COMPASS_ORIENT    int8             0            0  QGC sensors
COMPASS_ORIENT2   int8             0            0  QGC sensors
COMPASS_ORIENT3   int8             0            0  QGC sensors
COMPASS_LEARN     int8             0            0  QGC sensors
COMPASS_CAL_FIT   float         16.0         16.0  QGC sensors
INS_ACC_ID        int32      2753028      2753028  QGC sensors
INS_ACC2_ID       int32      2753036      2753036  QGC sensors
INS_ACC3_ID       int32            0            0  QGC sensors
INS_GYR_ID        int32      2752772      2752772  QGC sensors
INS_GYR2_ID       int32      2752780      2752780  QGC sensors
INS_GYR3_ID       int32            0            0  QGC sensors
BARO1_DEVID       int32        65540        65540  QGC sensors
BARO2_DEVID       int32        65796        65796  QGC sensors
BARO3_DEVID       int32            0            0  QGC sensors
AHRS_ORIENTATION  int8             0            0  QGC sensors
RCMAP_ROLL        int8             1            1  QGC radio
RCMAP_PITCH       int8             2            2  QGC radio
RCMAP_THROTTLE    int8             3            3  QGC radio
RCMAP_YAW         int8             4            4  QGC radio
RC1_MIN           int16         1000         1000  QGC radio
RC1_MAX           int16         2000         2000  QGC radio
RC1_TRIM          int16         1500         1500  QGC radio
RC1_REVERSED      int8             0            0  QGC radio
RC1_DZ            int16           20           30  QGC radio
RC2_MIN           int16         1000         1000  QGC radio
RC2_MAX           int16         2000         2000  QGC radio
RC2_TRIM          int16         1500         1500  QGC radio
RC2_REVERSED      int8             0            0  QGC radio
RC2_DZ            int16           20           30  QGC radio
RC3_MIN           int16         1000         1000  QGC radio
RC3_MAX           int16         2000         2000  QGC radio
RC3_TRIM          int16         1500         1000  QGC radio
RC3_REVERSED      int8             0            0  QGC radio
RC3_DZ            int16           30           30  QGC radio
RC4_MIN           int16         1000         1000  QGC radio
RC4_MAX           int16         2000         2000  QGC radio
RC4_TRIM          int16         1500         1500  QGC radio
RC4_REVERSED      int8             0            0  QGC radio
RC4_DZ            int16           20           30  QGC radio
RC5_MIN           int16         1000         1000  QGC radio
RC5_MAX           int16         2000         2000  QGC radio
RC5_TRIM          int16         1500         1500  QGC radio
RC5_REVERSED      int8             0            0  QGC radio
RC5_DZ            int16            0            0  QGC radio
RC6_MIN           int16         1000         1000  QGC radio
RC6_MAX           int16         2000         2000  QGC radio
RC6_TRIM          int16         1500         1500  QGC radio
RC6_REVERSED      int8             0            0  QGC radio
RC6_DZ            int16            0            0  QGC radio
RC7_MIN           int16         1000         1000  QGC radio
RC7_MAX           int16         2000         2000  QGC radio
RC7_TRIM          int16         1500         1500  QGC radio
RC7_REVERSED      int8             0            0  QGC radio
RC7_DZ            int16            0            0  QGC radio
RC8_MIN           int16         1000         1000  QGC radio
RC8_MAX           int16         2000         2000  QGC radio
RC8_TRIM          int16         1500         1500  QGC radio
RC8_REVERSED      int8             0            0  QGC radio
RC8_DZ            int16            0            0  QGC radio
FLTMODE_CH        int8             5            8  QGC modes
FLTMODE1          int8             7           10  QGC modes
FLTMODE2          int8             9           11  QGC modes
FLTMODE3          int8             6           12  QGC modes
FLTMODE4          int8             3            5  QGC modes
FLTMODE5          int8             5            2  QGC modes
FLTMODE6          int8             0            0  QGC modes
SIMPLE            int8             0            -  QGC modes
SUPER_SIMPLE      int8             0            -  QGC modes
RC6_OPTION        int16            0            0  QGC modes
RC7_OPTION        int16            7            0  QGC modes
RC8_OPTION        int16            0            0  QGC modes
RC9_OPTION        int16            0            0  QGC modes
RC10_OPTION       int16            0            0  QGC modes
RC11_OPTION       int16            0            0  QGC modes
RC12_OPTION       int16            0            0  QGC modes
RC13_OPTION       int16            0            0  QGC modes
RC14_OPTION       int16            0            0  QGC modes
RC15_OPTION       int16            0            0  QGC modes
RC16_OPTION       int16            0            0  QGC modes
BATT_ARM_VOLT     float          0.0          0.0  QGC power
BATT_AMP_PERVLT   float         17.0         17.0  QGC power
BATT_AMP_OFFSET   float          0.0          0.0  QGC power
BATT_VOLT_MULT    float         10.1         10.1  QGC power
BATT_VOLT_PIN     int8            13           13  QGC power
BATT_CURR_PIN     int8            12           12  QGC power
BATT2_MONITOR     int8             0            0  QGC power
FS_THR_VALUE      int16          975            -  QGC safety
FS_CRASH_CHECK    int8             1            -  QGC safety
FS_DR_ENABLE      int8             2            -  QGC safety
FS_DR_TIMEOUT     int16           30            -  QGC safety
FS_VIBE_ENABLE    int8             1            -  QGC safety
THR_FS_VALUE      int16            -          950  QGC safety
FENCE_AUTOENABLE  int8             0            0  QGC safety
FENCE_RET_RALLY   int8             -            0  QGC safety
ATC_RAT_RLL_P     float        0.135            -  QGC tuning
ATC_RAT_RLL_I     float        0.135            -  QGC tuning
ATC_RAT_RLL_D     float       0.0036            -  QGC tuning
ATC_RAT_PIT_P     float        0.135            -  QGC tuning
ATC_RAT_PIT_I     float        0.135            -  QGC tuning
ATC_RAT_PIT_D     float       0.0036            -  QGC tuning
ATC_RAT_YAW_P     float          0.3            -  QGC tuning
ATC_RAT_YAW_I     float         0.02            -  QGC tuning
ATC_RAT_YAW_D     float          0.0            -  QGC tuning
ATC_ANG_RLL_P     float          4.5            -  QGC tuning
ATC_ANG_PIT_P     float          4.5            -  QGC tuning
ATC_ANG_YAW_P     float          4.5            -  QGC tuning
PSC_ACCZ_P        float          0.5            -  QGC tuning
PSC_ACCZ_I        float          1.0            -  QGC tuning
ATC_INPUT_TC      float         0.15            -  QGC tuning
MOT_SPIN_ARM      float          0.1            -  QGC tuning
MOT_SPIN_MIN      float         0.15            -  QGC tuning
MOT_THST_HOVER    float         0.39            -  QGC tuning
AUTOTUNE_AXES     int8             7            7  QGC tuning
AUTOTUNE_AGGR     float        0.075            -  QGC tuning
AUTOTUNE_MIN_D    float       0.0005            -  QGC tuning
TUNE              int8             0            -  QGC tuning
TUNE_MIN          float          0.0            -  QGC tuning
TUNE_MAX          float          0.0            -  QGC tuning
COMPASS_ENABLE    int8             1            1  MP compass
COMPASS_AUTODEC   int8             1            1  MP compass
COMPASS_DEC       float  0.077115625  0.077115625  MP compass
COMPASS_AUTO_ROT  int8             2            2  MP compass
COMPASS_MOT_X     float          0.0          0.0  MP compass
COMPASS_MOT_Y     float          0.0          0.0  MP compass
COMPASS_MOT_Z     float          0.0          0.0  MP compass
COMPASS_MOT2_X    float          0.0          0.0  MP compass
COMPASS_MOT2_Y    float          0.0          0.0  MP compass
COMPASS_MOT2_Z    float          0.0          0.0  MP compass
COMPASS_MOT3_X    float          0.0          0.0  MP compass
COMPASS_MOT3_Y    float          0.0          0.0  MP compass
COMPASS_MOT3_Z    float          0.0          0.0  MP compass
INS_ENABLE_MASK   int8           127          127  MP sensors
INS_LOG_BAT_CNT   int16         1024         1024  MP sensors
ARSPD_TYPE        int8             -            2  MP sensors
ARSPD_USE         int8             -            1  MP sensors
GPS1_TYPE         int8             1            1  MP hardware
GPS2_TYPE         int8             0            0  MP hardware
MNT1_TYPE         int8             0            0  MP hardware
CAM1_TYPE         int8             0            0  MP hardware
RNGFND1_TYPE      int8             0            0  MP hardware
ADSB_TYPE         int8             0            0  MP hardware
SCR_ENABLE        int8             0            0  MP hardware
SERVO_32_ENABLE   int8             0            0  MP hardware
SERIAL0_BAUD      int32          115          115  MP hardware
SERIAL0_PROTOCOL  int8             2            2  MP hardware
SERIAL1_BAUD      int32           57           57  MP hardware
SERIAL1_PROTOCOL  int8             2            2  MP hardware
SERVO1_MIN        int16         1100         1100  MP servo
SERVO1_MAX        int16         1900         1900  MP servo
SERVO1_TRIM       int16         1500         1500  MP servo
SERVO1_REVERSED   int8             0            0  MP servo
SERVO1_FUNCTION   int16           33            4  MP servo
SERVO2_MIN        int16         1100         1100  MP servo
SERVO2_MAX        int16         1900         1900  MP servo
SERVO2_TRIM       int16         1500         1500  MP servo
SERVO2_REVERSED   int8             0            0  MP servo
SERVO2_FUNCTION   int16           34           19  MP servo
SERVO3_MIN        int16         1100         1000  MP servo
SERVO3_MAX        int16         1900         2000  MP servo
SERVO3_TRIM       int16         1500         1000  MP servo
SERVO3_REVERSED   int8             0            0  MP servo
SERVO3_FUNCTION   int16           35           70  MP servo
SERVO4_MIN        int16         1100         1100  MP servo
SERVO4_MAX        int16         1900         1900  MP servo
SERVO4_TRIM       int16         1500         1500  MP servo
SERVO4_REVERSED   int8             0            0  MP servo
SERVO4_FUNCTION   int16           36           21  MP servo
TERRAIN_ENABLE    int8             1            1  MP planner
WP_YAW_BEHAVIOR   int8             2            -  MP planner
LOG_BITMASK       int32       180222        65535  MP planner
TERRAIN_FOLLOW    int32            -            0  MAVProxy
ALT_OFFSET        int16            -            0  MAVProxy
ICE_ENABLE        int8             -            0  MAVProxy
GCS_PID_MASK      int16            0            0  MAVProxy
ARMING_MIS_ITEMS  int32            0            0  MAVProxy
"""
_WIDTHS = {"int8": 8, "int16": 16, "int32": 32}


def _table(column: int) -> dict[str, float | int]:
    """Return names and values of a column of the rows."""
    values: dict[str, float | int] = {}
    for row in _ROWS.strip().splitlines():
        cells = row.split()
        if cells[column] != "-":
            values[cells[0]] = float(cells[column]) if cells[1] == "float" else int(cells[column])
    return values


COPTER, PLANE = _table(2), _table(3)
BITS = {row.split()[0]: _WIDTHS[row.split()[1]] for row in _ROWS.strip().splitlines() if " float " not in row}
