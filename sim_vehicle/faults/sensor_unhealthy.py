"""A sensor is reported unhealthy."""

from enum import Enum

from pydantic import Field
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.vehicle.injected_faults import FaultEffect


class Sensor(Enum):
    GYRO = "gyro"
    ACCEL = "accel"
    MAG = "mag"
    BARO = "baro"
    AIRSPEED = "airspeed"
    GPS = "gps"
    RC = "rc"
    AHRS = "ahrs"
    LOGGING = "logging"
    BATTERY = "battery"


BITS = {
    Sensor.GYRO: mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO,
    Sensor.ACCEL: mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    Sensor.MAG: mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG,
    Sensor.BARO: mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,
    Sensor.AIRSPEED: mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE,
    Sensor.GPS: mavlink.MAV_SYS_STATUS_SENSOR_GPS,
    Sensor.RC: mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER,
    Sensor.AHRS: mavlink.MAV_SYS_STATUS_AHRS,
    Sensor.LOGGING: mavlink.MAV_SYS_STATUS_LOGGING,
    Sensor.BATTERY: mavlink.MAV_SYS_STATUS_SENSOR_BATTERY,
}


class Params(FaultParams):
    sensor: Sensor = Field(default=Sensor.MAG, description="affected sensor")


def begin(target: FaultTarget, params: Params, now: float) -> EndFault:
    return target.apply(FaultEffect(unhealthy_sensors=BITS[params.sensor]), now)


FAULT = Fault("sensor_unhealthy", "a sensor is unhealthy; arming checks refuse to arm", Params, begin)
