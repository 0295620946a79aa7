"""A fleet of simulated vehicles that speak MAVLink 2 on the wire like real autopilots.

Start with `fleet.Fleet`. The fleet does no I/O: bytes and simulated time in, bytes out. It therefore also
runs on a virtual clock. The package imports nothing of `swarmctl`; the two packages communicate by MAVLink
only. README.md lists the subpackages.
"""

__version__ = "0.1.0"
