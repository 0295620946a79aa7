"""The shape of a personality."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum, auto

from sim_vehicle.mission import Item


class Behaviour(Enum):
    """What a vehicle does in a mode when nobody holds a stick."""

    MISSION = auto()
    GUIDED = auto()  # goes where it is told, else holds
    BRAKE = auto()  # stops and holds
    RETURN = auto()
    LAND = auto()
    SINK = auto()  # the throttle stick reads its minimum: down at the pilot's descent rate
    DROP = auto()  # the same without altitude control


@dataclass(frozen=True, slots=True)
class Mode:
    """One flight mode: its wire number and what matters about it from outside."""

    number: int
    name: str
    behaviour: Behaviour
    armable: bool = False  # by a ground station
    needs_position: bool = True


@dataclass(frozen=True, slots=True)
class Personality:
    """One autopilot's data; times in s, versions as on the wire."""

    autopilot: int  # MAV_AUTOPILOT
    vehicle_type: int  # MAV_TYPE
    modes: Mapping[int, Mode]
    boot_mode: int
    boot_text: tuple[bytes, ...]  # plain bytes on the link at each boot
    flight_sw_version: int
    capabilities: int
    parameters: Mapping[str, float]
    read_only_parameters: frozenset[str]
    streams: Mapping[int, tuple[int, ...]]  # MAV_DATA_STREAM -> message ids
    store_item: Callable[[Item], Item | int]  # kept item, or MAV_MISSION_RESULT
    max_mission_items: int
