"""The fleet behind the pytest fixtures."""
