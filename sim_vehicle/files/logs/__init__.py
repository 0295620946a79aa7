"""The flight as the vehicle itself records it, in its autopilot's own file format, kept in memory.

`record` is the vocabulary, `recorder` keeps the logs of one vehicle within limits, `dataflash` writes
ArduPilot's format and `ulog` PX4's. Nothing here knows a vehicle: what happens is told to the recorder.
"""
