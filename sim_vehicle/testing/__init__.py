"""Vehicles for other people's tests: what the pytest fixtures hand out."""
