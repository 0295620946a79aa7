"""A vehicle with a payload of its own: what it sees comes over the bus (`swarmctl.bus.external_observations`)."""

from __future__ import annotations

from swarmctl.core.vehicle import VehicleState


class External:
    """Simulates nothing: wherever the vehicle is, there is nothing to see but what its payload reports."""

    def look(self, vehicle: VehicleState) -> tuple[tuple[int, int, bool], ...]:
        """Always empty."""
        return ()
