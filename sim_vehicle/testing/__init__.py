"""Vehicles for tests, as the pytest fixtures provide them."""
