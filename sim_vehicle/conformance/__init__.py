"""A conformance suite for MAVLink autopilots: named checks of one vehicle at a URL.

`checks/` defines the checks and `registry` lists them. `vehicle` is the vehicle under test, and `traffic` has
the messages to and from the vehicle. `sim_vehicle.station` repeats the requests until their answer. `guard`
lists the forbidden frames. `dialects` has the known behaviour of each autopilot where the specification
allows a choice. `runner` runs the checks, `report` prints the results. Only `link_wire` uses the network, by
the links of the simulator, and a real clock. On the wire of a `Fleet`, the same checks run in simulated time.
"""
