"""The autopilot of one vehicle without I/O: messages and time in, messages out.

Start with `autopilot`, which makes the parts; `interface` has the type by which the parts know the vehicle.
`flight_parameters` has what an autopilot's parameters say, a record for each part.
"""
