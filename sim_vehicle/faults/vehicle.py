"""Faults of the vehicle itself: its sensors, its energy, its motors, its answers."""

from typing import Annotated, Literal

from pydantic import Field
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.faults.base import EndFault, Fault, FaultTarget, Share, VehicleFault
from sim_vehicle.vehicle.injected_faults import FaultEffect, MissionRefusal

Offset = Annotated[float, Field(ge=-1e6, le=1e6)]
SENSORS = {
    "gyro": mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO,
    "accel": mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    "mag": mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG,
    "baro": mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,
    "airspeed": mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE,
    "gps": mavlink.MAV_SYS_STATUS_SENSOR_GPS,
    "rc": mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER,
    "ahrs": mavlink.MAV_SYS_STATUS_AHRS,
    "logging": mavlink.MAV_SYS_STATUS_LOGGING,
    "battery": mavlink.MAV_SYS_STATUS_SENSOR_BATTERY,
}


class GpsLoss(VehicleFault):
    name, summary = "gps_loss", "no GPS fix"

    def effect(self) -> FaultEffect:
        return FaultEffect(gps_lost=True)


class GpsGlitch(Fault):
    name, summary = "gps_glitch", "the GPS reports a wrong position, by a jump or by a ramp"

    east_m: Offset = Field(default=30.0, description="error eastward")
    north_m: Offset = Field(default=0.0, description="error northward")
    up_m: Offset = Field(default=0.0, description="error upward")
    ramp_s: Annotated[float, Field(ge=0)] = Field(default=0.0, description="duration of the ramp; 0: a jump")

    def begin(self, target: FaultTarget, now: float) -> EndFault:
        def apply(share: float, at_s: float) -> EndFault:
            offset_m = self.east_m * share, self.north_m * share, self.up_m * share
            return target.vehicle.injected_faults.begin(FaultEffect(gps_offset_m=offset_m), at_s)

        if self.ramp_s == 0:
            return apply(1.0, now)

        end_effect = apply(0.0, now)

        def grow(tick_s: float) -> None:
            nonlocal end_effect
            end_effect(tick_s)
            share = min((tick_s - now) / self.ramp_s, 1.0)
            end_effect = apply(share, tick_s)
            if share == 1.0:
                stop_growing()

        stop_growing = target.every_tick(grow)

        def end(end_s: float) -> None:
            stop_growing()
            end_effect(end_s)

        return end


class BatterySag(VehicleFault):
    name, summary = "battery_sag", "the battery's voltage or charge drops"

    sag_v: Annotated[float, Field(ge=0, le=60)] = Field(default=1.5, description="drop of the voltage")
    at_most: Share = Field(
        default=1.0, description="upper limit of the charge, as a share of the full charge"
    )

    def effect(self) -> FaultEffect:
        return FaultEffect(battery_sag_v=self.sag_v, battery_at_most=self.at_most)


class MotorLoss(VehicleFault):
    name = "motor_loss"
    summary = "motors stop: a copter sinks (one motor) or falls (more motors), a plane glides"

    motors: Annotated[int, Field(ge=1, le=4)] = Field(default=1, description="number of lost motors")

    def effect(self) -> FaultEffect:
        return FaultEffect(motors_lost=self.motors)


class RcLoss(VehicleFault):
    name, summary = "rc_loss", "the remote control is lost"

    def effect(self) -> FaultEffect:
        return FaultEffect(rc_lost=True)


class MissionRefused(VehicleFault):
    name, summary = "mission_refused", "uploads of missions, fences and rally points are refused"

    result: Literal[
        "error", "unsupported_frame", "unsupported", "no_space", "invalid", "invalid_sequence", "denied",
        "operation_cancelled",
    ] = Field(default="error", description="MAV_MISSION_RESULT of the refusal")  # fmt: skip
    at_item: Annotated[int, Field(ge=0)] | None = Field(
        default=None, description="item at which the upload is refused; none: at MISSION_COUNT"
    )

    def effect(self) -> FaultEffect:
        result = int(getattr(mavlink, f"MAV_MISSION_{self.result.upper()}"))
        return FaultEffect(mission_refusal=MissionRefusal(result, self.at_item))


class SlowAck(VehicleFault):
    name, summary = "slow_ack", "COMMAND_ACK and MISSION_ACK arrive late"

    delay_s: Annotated[float, Field(gt=0, le=60)] = Field(
        default=2.0, description="delay of acknowledgements"
    )

    def effect(self) -> FaultEffect:
        return FaultEffect(ack_delay_s=self.delay_s)


class AbsentAck(VehicleFault):
    name, summary = "absent_ack", "COMMAND_ACK and MISSION_ACK are lost"

    rate: Share = Field(default=1.0, description="share of the acknowledgements lost")

    def effect(self) -> FaultEffect:
        return FaultEffect(ack_loss=self.rate)


class Reboot(Fault):
    name, summary = "reboot", "the autopilot restarts: silence, motors off, boot text"

    silence_s: Annotated[float, Field(gt=0, le=600)] = Field(
        default=1.5, description="time until the boot text"
    )

    def begin(self, target: FaultTarget, now: float) -> EndFault:
        target.vehicle.reboot(now, self.silence_s)
        return lambda _now: None


class StuckMode(VehicleFault):
    name, summary = "stuck_mode", "mode changes are acknowledged or refused, but not carried out"

    answer: Literal["accepted", "refused"] = Field(default="accepted", description="answer to a mode change")

    def effect(self) -> FaultEffect:
        return FaultEffect(mode_stuck=self.answer == "accepted")


class SensorUnhealthy(VehicleFault):
    name, summary = "sensor_unhealthy", "a sensor is unhealthy; arming checks refuse to arm"

    sensor: Literal["gyro", "accel", "mag", "baro", "airspeed", "gps", "rc", "ahrs", "logging", "battery"] = (
        Field(default="mag", description="affected sensor")
    )

    def effect(self) -> FaultEffect:
        return FaultEffect(unhealthy_sensors=SENSORS[self.sensor])


class ClockDrift(VehicleFault):
    """The error of a crystal is about 20 ppm, of an oscillator without a crystal about 10 000 ppm."""

    name, summary = "clock_drift", "time since boot, TIMESYNC and SYSTEM_TIME drift"

    drift_ppm: Annotated[float, Field(ge=-500_000, le=500_000)] = Field(
        default=1000.0, description="drift of the clock, positive if fast"
    )

    def effect(self) -> FaultEffect:
        return FaultEffect(clock_drift_ppm=self.drift_ppm)
