"""A fleet of vehicles in software that speak MAVLink 2 on the wire like real autopilots.

Everything but `server` and `__main__` is pure: bytes and simulated time in, bytes out, so a fleet also runs
under a virtual clock (`fleet.Fleet`). The package imports nothing of the ground station; the two meet on the
wire only.
"""

__version__ = "0.1.0"
