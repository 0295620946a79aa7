"""Simultaneous arrival: one arrival time for all vehicles, and the speed or route of each that meets it."""
