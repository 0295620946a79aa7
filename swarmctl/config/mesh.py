"""Who listens where in an ad-hoc mesh: `communication.mesh` names vehicles by system id or by name."""

from __future__ import annotations

from collections.abc import Mapping

from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.core.texts import resolve_vehicles


def vehicle_of(word: int | str, names: Mapping[int, str]) -> int:
    """The system id that a word of a configuration means; `names` are the swarm's vehicles, by system id.

    Raises ValueError where it means none of them, or two.
    """
    (uav,) = resolve_vehicles([word], names)
    return uav


def mesh_endpoints(mesh: Mapping[str, str], names: Mapping[int, str]) -> dict[int, BusEndpoint]:
    """Where each vehicle's agent listens, by system id.

    Raises ValueError where a word means no vehicle or two, a vehicle is given twice, or an endpoint is none.
    """
    found: dict[int, BusEndpoint] = {}
    for word, endpoint in mesh.items():
        uav = vehicle_of(word, names)
        if uav in found:
            raise ValueError(f"{names[uav]} is given twice; a vehicle listens at one endpoint")
        found[uav] = parse_endpoint(endpoint)
    return found
