"""A ground station that flies a swarm of MAVLink vehicles across an area of unknown threats.

Who imports whom: cli -> app -> runner -> {links -> mavlink, bus, sensors, agent -> planners} -> core. The
deciding code (core, planners, mavlink, agent) is pure; links, bus, record, runner and app do the I/O.
"""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("mavlink-swarmctl")
except PackageNotFoundError:  # run from a checkout that is not installed
    __version__ = "0+unknown"
