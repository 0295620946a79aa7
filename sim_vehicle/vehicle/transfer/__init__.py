"""The vehicle's side of the mission protocol: one state machine per autopilot, without I/O.

ArduPilot serves missions, fences and rally points by three independent servers and writes a mission item by
item. PX4 has one state machine and one partner for all three lists, and replaces a stored list at the end of
the upload. `wire` converts between items and messages for both autopilots.
"""
