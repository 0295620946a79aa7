"""The one client of vehicles, without sockets and clocks: for scenarios, the conformance suite and test rigs.

`frames` packs and parses messages. `messages` has their contents. `exchanges` has the requests to a vehicle.
The simulated vehicles are not imported, so the client fits any vehicle.
"""
