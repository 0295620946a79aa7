"""Telemetry of a vehicle: presence, state, text, streams, mission and instruments."""
