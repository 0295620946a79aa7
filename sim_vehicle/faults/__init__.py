"""The registry of faults."""

from sim_vehicle.faults import (
    absent_ack,
    bandwidth,
    battery_sag,
    burst_loss,
    clock_drift,
    corruption,
    delay,
    duplication,
    gps_glitch,
    gps_loss,
    link_outage,
    mission_refused,
    motor_loss,
    one_way,
    packet_loss,
    rc_loss,
    reboot,
    reordering,
    sensor_unhealthy,
    sik_radio,
    slow_ack,
    stuck_mode,
)
from sim_vehicle.faults.base import Fault

FAULTS: dict[str, Fault] = {
    fault.name: fault
    for fault in (
        # the link
        packet_loss.FAULT,
        burst_loss.FAULT,
        delay.FAULT,
        duplication.FAULT,
        reordering.FAULT,
        corruption.FAULT,
        bandwidth.FAULT,
        sik_radio.FAULT,
        link_outage.FAULT,
        one_way.FAULT,
        # the vehicle
        gps_loss.FAULT,
        gps_glitch.FAULT,
        battery_sag.FAULT,
        motor_loss.FAULT,
        rc_loss.FAULT,
        mission_refused.FAULT,
        slow_ack.FAULT,
        absent_ack.FAULT,
        reboot.FAULT,
        stuck_mode.FAULT,
        sensor_unhealthy.FAULT,
        clock_drift.FAULT,
    )
}
