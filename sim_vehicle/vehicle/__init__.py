"""The autopilot of one vehicle without I/O: messages and time in, messages out.

Start with `autopilot`. The parts of a vehicle use each other through `interface` and
`personalities.base.Vehicle`.
"""
