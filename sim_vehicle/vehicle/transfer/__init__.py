"""The vehicle's side of the mission protocol: one machine an autopilot, without I/O.

ArduPilot serves missions, fences and rally points by three servers that know nothing of each other and
write a mission item by item; PX4 has one machine with one partner for all three and swaps a complete list
in at the end. What they share is small (items to messages and back, `wire`), so they are two machines and
not one with switches.
"""

from sim_vehicle.vehicle.transfer.ardupilot import ArduPilotTransfer
from sim_vehicle.vehicle.transfer.px4 import Px4Transfer

__all__ = ["ArduPilotTransfer", "Px4Transfer"]
