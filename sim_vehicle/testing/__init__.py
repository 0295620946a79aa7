"""The vehicles of the pytest fixtures."""
