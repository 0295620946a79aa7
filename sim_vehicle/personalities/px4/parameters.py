"""Parameters of PX4 1.15, multicopter and fixed wing in simulation: names, units, types and defaults.

An int is an INT32 and a float a REAL32 on the wire. `flight_parameters` converts them.
"""

# Parameters without an effect; ground stations read them before a flight.
_NO_EFFECT: dict[str, float | int] = {
    # battery, arming, modes
    "BAT1_V_EMPTY": 3.6,  # V a cell
    "BAT1_SOURCE": 0,
    "BAT1_R_INTERNAL": 0.005,  # ohm
    "BAT1_V_LOAD_DROP": 0.1,  # V a cell
    "CBRK_FLIGHTTERM": 121212,
    "CBRK_IO_SAFETY": 22027,
    "CBRK_SUPPLY_CHK": 894281,
    "CBRK_USB_CHK": 197848,
    "COM_FLTMODE1": -1,
    "COM_FLTMODE2": -1,
    "COM_FLTMODE3": -1,
    "COM_FLTMODE4": -1,
    "COM_FLTMODE5": -1,
    "COM_FLTMODE6": -1,
    "COM_OBS_AVOID": 0,
    "COM_POS_FS_EPH": 5.0,  # m
    "COM_PREARM_MODE": 0,
    "CP_DIST": -1.0,  # m
    # fence and missions
    "GF_PREDICT": 0,
    "GF_SOURCE": 0,
    "MIS_YAW_ERR": 12.0,  # deg
    "MIS_YAW_TMT": -1.0,  # s
    "NAV_MIN_LTR_ALT": -1.0,  # m
    # MAVLink and the system
    "MAV_COMP_ID": 1,
    "MAV_FWDEXTSP": 1,
    "MAV_HASH_CHK_EN": 1,
    "MAV_HB_FORW_EN": 1,
    "MAV_PROTO_VER": 2,
    "MAV_RADIO_TOUT": 5,  # s
    "SDLOG_PROFILE": 131,
    "SYS_AUTOCONFIG": 0,
    "SYS_BL_UPDATE": 0,
    "SYS_HAS_BARO": 1,
    "SYS_HAS_GPS": 1,
    "SYS_HAS_MAG": 1,
    "SYS_HITL": 0,
    # marks of a calibrated vehicle
    "CAL_ACC0_ID": 1_310_988,
    "CAL_ACC1_ID": 1_310_996,
    "CAL_GYRO0_ID": 1_310_988,
    "CAL_GYRO1_ID": 1_310_996,
    "CAL_MAG0_ID": 197_388,
    "CAL_MAG1_ID": 197_644,
    "CAL_MAG2_ID": 0,
    "CAL_MAG0_ROT": -1,
    "CAL_MAG_SIDES": 63,
    "SENS_BOARD_ROT": 0,
    "SENS_BOARD_X_OFF": 0.000001,  # deg
    "SENS_BOARD_Y_OFF": 0.0,  # deg
    "SENS_BOARD_Z_OFF": 0.0,  # deg
    "SENS_DPRES_OFF": 0.001,  # Pa
    "EKF2_EN": 1,
    "EKF2_GPS_CTRL": 7,
    "EKF2_REQ_GPS_H": 0.5,  # s
    # RC channels: none mapped
    "RC_CHAN_CNT": 0,
    "RC_MAP_ARM_SW": 0,
    "RC_MAP_AUX1": 0,
    "RC_MAP_AUX2": 0,
    "RC_MAP_FLAPS": 0,
    "RC_MAP_FLTMODE": 0,
    "RC_MAP_KILL_SW": 0,
    "RC_MAP_PITCH": 0,
    "RC_MAP_RETURN_SW": 0,
    "RC_MAP_ROLL": 0,
    "RC_MAP_THROTTLE": 0,
    "RC_MAP_YAW": 0,
}
_NO_EFFECT_COPTER: dict[str, float | int] = {
    "CA_AIRFRAME": 0,
    "CA_ROTOR_COUNT": 4,
    "MAV_TYPE": 2,
    "MPC_LAND_ALT3": 1.0,  # m
    "MPC_LAND_CRWL": 0.3,  # m/s
    "RTL_TYPE": 0,
    "SYS_AUTOSTART": 4001,
    "SYS_HAS_NUM_ASPD": 0,
}
_NO_EFFECT_PLANE: dict[str, float | int] = {
    "CA_AIRFRAME": 1,
    "COM_POS_FS_EPH": 50.0,
    "FW_GND_SPD_MIN": 5.0,  # m/s
    "FW_LAUN_DETCN_ON": 0,
    "FW_LND_ABORT": 3,  # bits: 0 terrain not found, 1 lost
    "FW_LND_USETER": 1,
    "FW_TKO_PITCH_MIN": 10.0,  # deg
    "FW_T_SINK_MIN": 2.0,  # m/s
    "MAV_TYPE": 1,
    "SYS_AUTOSTART": 4003,
    "SYS_HAS_NUM_ASPD": 1,
}

_COMMON: dict[str, float | int] = _NO_EFFECT | {
    # battery 1 and its stages, as shares of the capacity
    "BAT1_CAPACITY": 5000.0,  # mAh
    "BAT1_N_CELLS": 4,
    "BAT1_V_CHARGED": 4.05,  # V a cell
    "BAT_LOW_THR": 0.15,
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "COM_ARM_BAT_MIN": -1.0,  # lowest share for arming; less than 0: BAT_CRIT_THR
    "COM_LOW_BAT_ACT": 0,  # 0 warn, 1 return, 2 land, 3 return at critical and land at emergency level
    # arming, home, modes
    "COM_ARM_MIS_REQ": 0,  # 1: a valid mission is required to arm
    "COM_ARM_WO_GPS": 1,  # 0: arming requires a GPS fix in every mode
    "COM_DISARM_LAND": 2.0,  # s after a landing, 0 or less never
    "COM_DISARM_PRFLT": 10.0,  # s after arming without a take-off, 0 or less never
    "COM_FLIGHT_UUID": 0,
    "COM_HOME_EN": 1,  # 0: commands to set home are denied
    "COM_MOT_TEST_EN": 1,
    "COM_TAKEOFF_ACT": 0,  # after a take-off: 0 hold, 1 mission
    # links
    "COM_DL_LOSS_T": 10,  # s without a ground station's heartbeat
    "COM_FAIL_ACT_T": 5.0,  # s in hold before a failsafe acts
    "COM_OBL_RC_ACT": 0,  # offboard lost: 0-2 a pilot's mode, 3 return, 4 land, 5 hold, 6 terminate, 7 disarm
    "COM_OF_LOSS_T": 1.0,  # s without a set-point
    "COM_RCL_EXCEPT": 0,  # modes that continue without RC, bits: 0 mission, 1 hold and take-off, 2 offboard
    "COM_RC_LOSS_T": 0.5,  # s without a remote control
    "COM_RC_OVERRIDE": 1,  # moving sticks take over; bits: 0 from Auto modes, 1 from Offboard
    "COM_RC_STICK_OV": 30.0,  # % of the range per second from which sticks move
    "COM_RC_IN_MODE": 1,  # 0 RC, 1 joystick, 2 and 3 both, 4 no stick input
    "NAV_DLL_ACT": 0,  # 0 nothing, 1 hold, 2 return, 3 land, 5 terminate, 6 disarm
    "NAV_RCL_ACT": 2,  # as NAV_DLL_ACT
    # fence
    "GF_ACTION": 2,  # 0 nothing, 1 warn, 2 hold, 3 return, 4 terminate, 5 land
    "GF_MAX_HOR_DIST": 0.0,  # m from home, 0 none
    "GF_MAX_VER_DIST": 0.0,  # m above home, 0 none
    # mission and return
    "MIS_DIST_1WP": 900.0,  # m; 1.16: 10000, and only a warning
    "MIS_TKO_LAND_REQ": 0,  # 0 nothing, 1 take-off, 2 landing, 3 both, 4 both or neither
    "NAV_LOITER_RAD": 80.0,  # m
    "RTL_CONE_ANG": 45,  # multicopter: deg, half angle, within RTL_MIN_DIST; 0: always RTL_RETURN_ALT
    "RTL_MIN_DIST": 10.0,  # m
    # MAVLink and the system
    "MAV_SYS_ID": 1,
    "SDLOG_MODE": 1,
    "SYS_FAILURE_EN": 0,  # 1: MAV_CMD_INJECT_FAILURE is obeyed
    # environment of the simulation
    "SIM_WIND_DIR": 180.0,  # deg from which the wind blows; not a parameter of PX4
    "SIM_WIND_SPD": 0.0,  # m/s, 0: the scenario's wind; not a parameter of PX4
}

COPTER: dict[str, float | int] = (
    _COMMON
    | _NO_EFFECT_COPTER
    | {
        "FLW_TGT_ALT_M": 0,  # altitude above: 0 home, 1 the ground, 2 the target
        "FLW_TGT_DST": 8.0,  # m from the target
        "FLW_TGT_FA": 180.0,  # deg clockwise from the target's course
        "FLW_TGT_HT": 8.0,  # m
        "FLW_TGT_MAX_VEL": 5.0,  # m/s around the target
        "FLW_TGT_RS": 0.1,  # no effect: the target's messages are not filtered
        "MIS_TAKEOFF_ALT": 2.5,  # m above home
        "MPC_ACC_DOWN_MAX": 3.0,  # m/s^2
        "MPC_ACC_HOR": 3.0,  # m/s^2
        "MPC_ACC_HOR_MAX": 5.0,  # m/s^2 by sticks
        "MPC_ACC_UP_MAX": 4.0,  # m/s^2
        "MPC_LAND_ALT1": 10.0,  # m above home, below which a landing slows, and a take-off is slow
        "MPC_LAND_ALT2": 5.0,  # m above home, below which a landing has MPC_LAND_SPEED
        "MPC_JERK_AUTO": 4.0,  # m/s^3, toward a position
        "MPC_HOLD_DZ": 0.1,  # share of a stick's range
        "MPC_LAND_SPEED": 0.7,  # m/s
        "MPC_MANTHR_MIN": 0.08,  # output at the lowest throttle
        "MPC_MAN_TILT_MAX": 35.0,  # deg
        "MPC_MAN_Y_MAX": 150.0,  # deg/s
        "MPC_TILTMAX_AIR": 45.0,  # deg, by set-points
        "MPC_TKO_SPEED": 1.5,  # m/s, below MPC_LAND_ALT1
        "MPC_VEL_MANUAL": 10.0,  # m/s
        "MPC_XY_CRUISE": 5.0,  # m/s
        "MPC_XY_MAN_EXPO": 0.6,
        "MPC_XY_P": 0.95,  # m/s per m from a set-point
        "MPC_XY_VEL_P_ACC": 1.8,  # m/s^2 per m/s
        "MPC_XY_VEL_MAX": 12.0,  # m/s
        "MPC_YAWRAUTO_MAX": 45.0,  # deg/s
        "MPC_Z_VEL_MAX_DN": 1.5,  # m/s
        "MPC_Z_P": 1.0,  # m/s per m from a set-point
        "MPC_Z_VEL_MAX_UP": 3.0,  # m/s
        "MPC_Z_VEL_P_ACC": 4.0,  # m/s^2 per m/s
        "MPC_Z_V_AUTO_DN": 1.5,  # m/s
        "MPC_Z_V_AUTO_UP": 3.0,  # m/s
        "NAV_ACC_RAD": 2.0,  # m
        "NAV_MC_ALT_RAD": 0.8,  # m above or below an item
        "RTL_DESCEND_ALT": 10.0,  # m above home
        "RTL_LAND_DELAY": 0.0,  # s over home, -1: does not land
        "RTL_RETURN_ALT": 30.0,  # m above home
    }
)

PLANE: dict[str, float | int] = (
    _COMMON
    | _NO_EFFECT_PLANE
    | {
        "COM_DISARM_PRFLT": -1.0,
        "RTL_LOITER_RAD": 80.0,  # m
        "FW_AIRSPD_MAX": 20.0,  # m/s
        "FW_AIRSPD_MIN": 10.0,  # m/s
        "FW_AIRSPD_STALL": 7.0,  # m/s
        "FW_AIRSPD_TRIM": 15.0,  # m/s
        "FW_LND_AIRSPD": -1.0,  # m/s, -1: FW_AIRSPD_MIN
        "FW_LND_ANG": 5.0,  # deg
        "FW_P_LIM_MAX": 30.0,  # deg
        "FW_P_LIM_MIN": -30.0,  # deg
        "FW_R_LIM": 50.0,  # deg
        "FW_T_CLMB_MAX": 5.0,  # m/s
        "FW_T_CLMB_R_SP": 3.0,  # m/s by sticks
        "FW_T_SINK_MAX": 5.0,  # m/s
        "FW_T_SINK_R_SP": 2.0,  # m/s
        "MIS_TAKEOFF_ALT": 25.0,  # m above home
        "NAV_ACC_RAD": 10.0,  # m
        "NAV_FW_ALT_RAD": 10.0,  # m above or below a waypoint
        "NPFG_DAMPING": 0.7,
        "NPFG_PERIOD": 10.0,  # s
        "NPFG_SW_DST_MLT": 0.32,
        # 0 home or rally point, 1 mission landing or rally point, 2 along the mission, 3 the nearest of all
        "RTL_TYPE": 1,
        "RTL_DESCEND_ALT": 100.0,  # m above home
        "RTL_LAND_DELAY": -1.0,  # s over home, -1: does not land
        "RTL_RETURN_ALT": 100.0,  # m above home
    }
)
