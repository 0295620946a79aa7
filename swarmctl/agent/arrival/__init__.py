"""Simultaneous arrival: one arrival time for all vehicles, and a speed or route of each for that time."""
