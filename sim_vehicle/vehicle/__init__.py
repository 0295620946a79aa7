"""The autopilot of one vehicle: messages and time in, messages out. Pure.

Start with `autopilot`. The parts of a vehicle use each other through `interface` and
`personalities.base.Vehicle`.
"""
