"""Command handlers of ArduPlane that replace or extend `vehicle.commands`."""

from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import distance_m
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.command import Command
from sim_vehicle.vehicle.commands import ACCEPTED, FAILED
from sim_vehicle.vehicle.interface import CommandHandler, Vehicle
from sim_vehicle.vehicle.mission import Item


def start_landing(vehicle: Vehicle, now: float) -> bool:
    """Start AUTO at the nearest landing sequence, regardless of MIS_RESTART; return False if impossible."""

    def distance_to_m(item: Item) -> float:
        place_deg = item.place_deg
        assert place_deg is not None
        return distance_m(vehicle.body.lat_lon_deg, place_deg)

    index = vehicle.mission.land_start(distance_to_m) if vehicle.position_known(now) else None
    if index is None or not vehicle.set_current(index):
        vehicle.announce("no_landing_sequence")
        return False
    vehicle.announce("landing_sequence")
    landing_index = vehicle.mission.index
    if not vehicle.modes.set_behaviour(Behaviour.MISSION, now):
        return False
    if vehicle.mission.index != landing_index:
        vehicle.set_current(index)
    return True


def land_start(vehicle: Vehicle, _command: Command, now: float) -> int:
    return ACCEPTED if start_landing(vehicle, now) else FAILED


def takeoff(_vehicle: Vehicle, _command: Command, _now: float) -> int:
    """Refuse NAV_TAKEOFF, a command for quadplanes. Other planes take off in TAKEOFF or AUTO."""
    return FAILED


PLANE_COMMANDS: MappingProxyType[int, CommandHandler] = MappingProxyType(
    {mavlink.MAV_CMD_DO_LAND_START: land_start, mavlink.MAV_CMD_NAV_TAKEOFF: takeoff}
)
