"""The approaches to formation flight: one file each. Pure.

An approach is a module that fits `base.Approach`. `place_keeping` has what they share. A new approach is a
file and a line in `APPROACHES`.
"""

from __future__ import annotations

from swarmctl.agent.formation.approaches import behavioural, leader_following, virtual_structure
from swarmctl.agent.formation.approaches.base import Approach

APPROACHES: dict[str, Approach] = {
    "leader_following": leader_following,
    "behavioural": behavioural,
    "virtual_structure": virtual_structure,
}
