"""A fleet of vehicles in software that speak MAVLink 2 on the wire like real autopilots.

`fleet.Fleet` is the way in. Everything but `links`, `serving` and the commands is pure: bytes and simulated
time in, bytes out, so a fleet also runs under a virtual clock. The package imports nothing of the ground
station; the two meet on the wire only. README.md says what lives in which room.
"""

__version__ = "0.1.0"
