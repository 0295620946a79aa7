"""A fleet of simulated vehicles that speak MAVLink 2 on the wire like real autopilots.

Start with `fleet.Fleet`. All modules except `links`, `serving` and the commands are pure: bytes and simulated
time in, bytes out. So a fleet also runs on a virtual clock. The package imports nothing of `swarmctl`; both
communicate on the wire only. README.md lists the subpackages.
"""

__version__ = "0.1.0"
