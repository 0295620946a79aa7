"""Runs of scenarios: a small ground station, the checks on every step, the verdict; and the `run` command."""
