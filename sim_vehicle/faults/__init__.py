"""The registry of faults: `link` and `sik_radio` have the faults of the link, `vehicle` has the others."""

from sim_vehicle.faults import link, vehicle
from sim_vehicle.faults.base import Fault
from sim_vehicle.faults.sik_radio import SikRadio

FAULTS: dict[str, type[Fault]] = {
    fault.name: fault
    for fault in (
        link.PacketLoss,
        link.BurstLoss,
        link.Delay,
        link.Duplication,
        link.Reordering,
        link.Corruption,
        link.Bandwidth,
        SikRadio,
        link.LinkOutage,
        link.OneWay,
        vehicle.GpsLoss,
        vehicle.GpsGlitch,
        vehicle.BatterySag,
        vehicle.MotorLoss,
        vehicle.RcLoss,
        vehicle.MissionRefused,
        vehicle.SlowAck,
        vehicle.AbsentAck,
        vehicle.Reboot,
        vehicle.StuckMode,
        vehicle.SensorUnhealthy,
        vehicle.ClockDrift,
    )
}
