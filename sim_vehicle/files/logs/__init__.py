"""Flight logs of the vehicle itself, in its autopilot's file format, kept in memory.

`record` has the types, `recorder` keeps the logs of one vehicle within limits, `dataflash` writes ArduPilot's
format and `ulog` PX4's. The vehicle calls the recorder; this room imports no vehicle.
"""
