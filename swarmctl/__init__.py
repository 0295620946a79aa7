"""A ground station that flies a swarm of MAVLink vehicles across an area of unknown threats.

`docs/architecture.md` lists the rooms and their permitted imports. The rooms core, planners, mavlink and
agent are pure.
"""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("mavlink-swarmctl")
except PackageNotFoundError:  # run from a checkout that is not installed
    __version__ = "0+unknown"
