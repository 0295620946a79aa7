"""A vehicle with a payload of its own, which reports over the bus (`swarmctl.bus.external_observations`)."""

from __future__ import annotations

from swarmctl.core.vehicle import VehicleState


class External:
    """A sensor that simulates nothing: the payload's reports are the only observations."""

    def look(self, vehicle: VehicleState) -> tuple[tuple[int, int, bool], ...]:
        """Return no observations."""
        return ()
