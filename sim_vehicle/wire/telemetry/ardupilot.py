"""Messages that only ArduPilot sends, and the messages of hardware that no simulated vehicle has."""

from collections.abc import Callable

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.attitude import quaternions
from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.motion import Bools
from sim_vehicle.wire.telemetry.motion import ekf_status_report, quaternion
from sim_vehicle.wire.telemetry.sensors import magnetic_field_mgauss, scaled_pressure, wind
from sim_vehicle.wire.telemetry.view import UNKNOWN_I16, Columns, View, north_east_down, vectors

FREE_MEMORY_BYTES, MAX_U16 = 524_288, 65_535
BOARD_MV = 5000
TERRAIN_SPACING_M, TERRAIN_BLOCKS = 100, 504
ESCS, ESC_TEMPERATURE_DEGC, FULL_RPM, ESC_PACKETS_HZ = 4, 32, 7000, 10
PLANE_ESC = 2  # the throttle of a plane is on output 3
PITOT_RATIO = 1.9936
NO_TEMPERATURE_DEGC = -128
# HL_FAILURE_FLAG for each sensor of SYS_STATUS that is not healthy
FAILURE_FLAGS = {
    mavlink.MAV_SYS_STATUS_SENSOR_GPS: mavlink.HL_FAILURE_FLAG_GPS,
    mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE: mavlink.HL_FAILURE_FLAG_ABSOLUTE_PRESSURE,
    mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL: mavlink.HL_FAILURE_FLAG_3D_ACCEL,
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO: mavlink.HL_FAILURE_FLAG_3D_GYRO,
    mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG: mavlink.HL_FAILURE_FLAG_3D_MAG,
    mavlink.MAV_SYS_STATUS_SENSOR_BATTERY: mavlink.HL_FAILURE_FLAG_BATTERY,
    mavlink.MAV_SYS_STATUS_GEOFENCE: mavlink.HL_FAILURE_FLAG_GEOFENCE,
    mavlink.MAV_SYS_STATUS_AHRS: mavlink.HL_FAILURE_FLAG_ESTIMATOR,
}
# Messages that ArduPilot knows, of hardware that no simulated vehicle has: a request is accepted, nothing is
# sent. RC_CHANNELS_RAW is sent on MAVLink 1 links only, PID_TUNING only with GCS_PID_MASK.
ABSENT = (
    mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS_SCALED,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS_RAW,
    mavlink.MAVLINK_MSG_ID_OPTICAL_FLOW,
    mavlink.MAVLINK_MSG_ID_GPS2_RAW,
    mavlink.MAVLINK_MSG_ID_GPS_RTK,
    mavlink.MAVLINK_MSG_ID_GPS2_RTK,
    mavlink.MAVLINK_MSG_ID_TERRAIN_REQUEST,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE3,
    mavlink.MAVLINK_MSG_ID_RANGEFINDER,
    mavlink.MAVLINK_MSG_ID_CAMERA_FEEDBACK,
    mavlink.MAVLINK_MSG_ID_MAG_CAL_PROGRESS,
    mavlink.MAVLINK_MSG_ID_MAG_CAL_REPORT,
    mavlink.MAVLINK_MSG_ID_PID_TUNING,
    mavlink.MAVLINK_MSG_ID_DEEPSTALL,
    mavlink.MAVLINK_MSG_ID_EFI_STATUS,
    mavlink.MAVLINK_MSG_ID_RPM,
    mavlink.MAVLINK_MSG_ID_ADSB_VEHICLE,
    mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION,
    mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS,
    mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS,
    mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION,
    mavlink.MAVLINK_MSG_ID_CAMERA_FOV_STATUS,
    mavlink.MAVLINK_MSG_ID_CAMERA_THERMAL_RANGE,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS,
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS,
    mavlink.MAVLINK_MSG_ID_AIS_VESSEL,
    mavlink.MAVLINK_MSG_ID_GENERATOR_STATUS,
    mavlink.MAVLINK_MSG_ID_RELAY_STATUS,
    mavlink.MAVLINK_MSG_ID_WINCH_STATUS,
    mavlink.MAVLINK_MSG_ID_UAVIONIX_ADSB_OUT_STATUS,
)


def _planes(v: View) -> Bools:
    return np.asarray(v.world.dynamics.planes[v.i])


def ahrs(_v: View) -> Columns:
    """Return no drift and no error: the simulated attitude is exact."""
    return {}


def ahrs2(v: View) -> Columns:
    """Return the second estimate, which is equal to the first."""
    lat, lon = v.e7()
    return {
        **vectors("roll", "pitch", "yaw", v.world.dynamics.attitude_rad[v.i]),
        "altitude": v.world.estimate_m[v.i, 2],
        "lat": lat,
        "lng": lon,
    }


def _true_motion(v: View) -> Columns:
    """Return attitude, specific force and body rates without errors."""
    dynamics, i = v.world.dynamics, v.i
    return {
        **vectors("roll", "pitch", "yaw", dynamics.attitude_rad[i]),
        **vectors("xacc", "yacc", "zacc", dynamics.specific_force_m_s2[i]),
        **vectors("xgyro", "ygyro", "zgyro", dynamics.rates_rad_s[i]),
    }


def _true_e7(v: View) -> tuple[Floats, Floats]:
    lat_deg, lon_deg = v.world.geodetic()
    return lat_deg[v.i] * 1e7, lon_deg[v.i] * 1e7


def simstate(v: View) -> Columns:
    """Return the true state."""
    lat, lon = _true_e7(v)
    return {**_true_motion(v), "lat": lat, "lng": lon}


def sim_state(v: View) -> Columns:
    """Return the true state; as in ArduPilot, `lat` and `lon` are also in 1e-7 deg."""
    dynamics, i = v.world.dynamics, v.i
    lat, lon = _true_e7(v)
    return {
        **_true_motion(v),
        **quaternion(v),
        "lat": lat,
        "lon": lon,
        "lat_int": lat,
        "lon_int": lon,
        "alt": dynamics.position_m[i, 2],
        **north_east_down("vn", "ve", "vd", dynamics.velocity_m_s[i]),
    }


def attitude_target(v: View) -> Columns:
    """Return the attitude that the attitude controller aims at, and the throttle."""
    dynamics, i = v.world.dynamics, v.i
    angles = np.column_stack([dynamics.wanted_tilt_rad[:, i].T, dynamics.wanted_heading_rad[i]])
    return {
        "time_boot_ms": v.since_boot_ms(),
        "q": quaternions(angles),
        "body_yaw_rate": dynamics.wanted_yaw_rate_rad_s[i],
        "thrust": dynamics.throttle[i],
    }


def aoa_ssa(v: View) -> Columns:
    """Return the angles of the airflow at the fuselage of a plane [deg]; 0 on the ground."""
    dynamics, i = v.world.dynamics, v.i
    east, north, up = (dynamics.velocity_m_s[i] - v.world.wind.wind_m_s[i]).T
    _, pitch, yaw = dynamics.attitude_rad[i].T
    attack = pitch - np.arctan2(up, np.hypot(east, north))
    side = np.arctan2(east, north) - yaw
    flying = dynamics.airborne[i]
    return {
        "time_usec": v.since_boot_us(),
        "AOA": np.where(flying, np.rad2deg(attack), 0.0),
        "SSA": np.where(flying, np.rad2deg(np.arctan2(np.sin(side), np.cos(side))), 0.0),
    }


def airspeed(v: View) -> Columns:
    """Return the airspeed, and the pressure at the pitot tube [Pa]."""
    speed_m_s = v.world.dynamics.airspeed_m_s[v.i]
    return {
        "airspeed": speed_m_s,
        "temperature": UNKNOWN_I16,
        "raw_press": speed_m_s**2 / PITOT_RATIO,
        "flags": mavlink.AIRSPEED_SENSOR_USING,
    }


def scaled_imu3(v: View) -> Columns:
    """Return the third compass; there is no third inertial sensor."""
    return {"time_boot_ms": v.since_boot_ms(), **vectors("xmag", "ymag", "zmag", magnetic_field_mgauss(v))}


def meminfo(_v: View) -> Columns:
    """Return the same free memory at all times."""
    return {"freemem": MAX_U16, "freemem32": FREE_MEMORY_BYTES}


def hwstatus(_v: View) -> Columns:
    return {"Vcc": BOARD_MV}


def mission_item_reached(v: View) -> Columns:
    """Return the item that was reached last since the boot; 65535: none."""
    return {"seq": v.status.item_reached[v.i]}


def terrain_report(v: View) -> Columns:
    """Return the terrain, which has the height of the vehicle's start everywhere."""
    lat, lon = v.e7()
    ground_m = v.world.dynamics.ground_m[v.i]
    return {
        "lat": lat,
        "lon": lon,
        "spacing": TERRAIN_SPACING_M,
        "terrain_height": ground_m,
        "current_height": v.world.estimate_m[v.i, 2] - ground_m,
        "loaded": TERRAIN_BLOCKS,
    }


def esc_telemetry_1_to_4(v: View) -> Columns:
    """Return the battery's voltage and current at the motors: four of a copter, one of a plane."""
    batteries, dynamics, i = v.world.batteries, v.world.dynamics, v.i
    planes = dynamics.planes[i]
    here = np.where(planes[:, None], np.arange(ESCS) == PLANE_ESC, True)
    share = np.where(planes, 1.0, 1.0 / ESCS)

    def each(values: Floats | float) -> Floats:
        return np.asarray(np.broadcast_to(values, len(i))[:, None] * here)

    return {
        "temperature": each(ESC_TEMPERATURE_DEGC),
        "voltage": each(batteries.voltage_v[i] * 100),
        "current": each(batteries.current_a[i] * share * 100),
        "totalcurrent": each(batteries.used_mah[i] * share),
        "rpm": each(np.where(v.world.armed[i], dynamics.throttle[i] * FULL_RPM, 0.0)),
        "count": each(np.floor(v.since_boot_s() * ESC_PACKETS_HZ) % (MAX_U16 + 1)),
    }


def autopilot_state_for_gimbal_device(v: View) -> Columns:
    dynamics, i = v.world.dynamics, v.i
    return {
        "time_boot_us": v.since_boot_us(),
        "q": quaternions(dynamics.attitude_rad[i]),
        **north_east_down("vx", "vy", "vz", v.world.estimate_velocity_m_s[i]),
        "estimator_status": ekf_status_report(v)["flags"],
        "angular_velocity_z": dynamics.rates_rad_s[i, 2],
    }


def high_latency2(v: View) -> Columns:
    """Return the summary for slow links; angles in 2 deg, speeds in 0.2 m/s, distances in 10 m."""
    status, dynamics, i = v.status, v.world.dynamics, v.i
    lat, lon = v.e7()
    to_target_m = dynamics.target_m[i] - v.world.estimate_m[i]
    bearing_deg = np.rad2deg(np.arctan2(to_target_m[:, 0], to_target_m[:, 1])) % 360
    velocity, air = v.world.estimate_velocity_m_s[i], wind(v)
    failures = sum(np.where(status.health[i] & sensor, 0, flag) for sensor, flag in FAILURE_FLAGS.items())
    return {
        "timestamp": v.since_boot_ms(),
        "type": status.vehicle_type[i],
        "autopilot": status.autopilot[i],
        "custom_mode": status.custom_mode[i],
        "latitude": lat,
        "longitude": lon,
        "altitude": v.world.estimate_m[i, 2],
        "target_altitude": dynamics.target_m[i, 2],
        "heading": np.floor(v.heading_deg() / 2),
        "target_heading": np.floor(bearing_deg / 2),
        "target_distance": np.floor(np.hypot(to_target_m[:, 0], to_target_m[:, 1]) / 10),
        "throttle": dynamics.throttle[i] * 100,
        "airspeed": dynamics.airspeed_m_s[i] * 5,
        "airspeed_sp": np.where(dynamics.armed[i], dynamics.speed_m_s[i] * 5, 0.0),
        "groundspeed": np.hypot(velocity[:, 0], velocity[:, 1]) * 5,
        "windspeed": air["speed"] * 5,
        "wind_heading": np.floor(air["direction"] % 360 / 2),
        "temperature_air": NO_TEMPERATURE_DEGC,
        "battery": v.world.batteries.remaining[i] * 100,
        "wp_num": status.mission_seq[i],
        "failure_flags": failures,
        "custom0": status.base_mode[i].astype(np.int8),
    }


BUILDERS: dict[int, Callable[[View], Columns]] = {
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM_REACHED: mission_item_reached,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: attitude_target,
    mavlink.MAVLINK_MSG_ID_SIM_STATE: sim_state,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU3: scaled_imu3,
    mavlink.MAVLINK_MSG_ID_TERRAIN_REPORT: terrain_report,
    mavlink.MAVLINK_MSG_ID_MEMINFO: meminfo,
    mavlink.MAVLINK_MSG_ID_AHRS: ahrs,
    mavlink.MAVLINK_MSG_ID_SIMSTATE: simstate,
    mavlink.MAVLINK_MSG_ID_HWSTATUS: hwstatus,
    mavlink.MAVLINK_MSG_ID_AHRS2: ahrs2,
    mavlink.MAVLINK_MSG_ID_HIGH_LATENCY2: high_latency2,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_STATE_FOR_GIMBAL_DEVICE: autopilot_state_for_gimbal_device,
    mavlink.MAVLINK_MSG_ID_AIRSPEED: airspeed,
    mavlink.MAVLINK_MSG_ID_AOA_SSA: aoa_ssa,
    mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4: esc_telemetry_1_to_4,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2: scaled_pressure,
}
# Message id -> mask of the vehicles with data for the message; absent: all vehicles.
HAS_DATA: dict[int, Callable[[View], Bools]] = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: lambda v: np.asarray(~v.world.dynamics.planes[v.i]),
    mavlink.MAVLINK_MSG_ID_TERRAIN_REPORT: lambda v: v.status.gps_seen[v.i],
    mavlink.MAVLINK_MSG_ID_AIRSPEED: _planes,
    mavlink.MAVLINK_MSG_ID_AOA_SSA: _planes,
}
