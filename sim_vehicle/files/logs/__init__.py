"""Onboard flight logs in the autopilot's file format, kept in memory.

`record` has the types. `recorder` keeps the logs of one vehicle within limits. `dataflash` writes ArduPilot's
format, `ulog` writes PX4's format.
"""
