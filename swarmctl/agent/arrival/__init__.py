"""Simultaneous arrival: a common arrival time, and a speed or a route by which each vehicle meets it."""
