"""The vehicle's side of the mission protocol: one machine per autopilot, without I/O.

ArduPilot serves missions, fences and rally points by three independent servers and writes a mission item by
item. PX4 has one machine with one partner for all three lists and swaps in a complete list at the end. The
conversion of items to messages is common (`wire`).
"""

from sim_vehicle.vehicle.transfer.ardupilot import ArduPilotTransfer
from sim_vehicle.vehicle.transfer.px4 import Px4Transfer

__all__ = ["ArduPilotTransfer", "Px4Transfer"]
