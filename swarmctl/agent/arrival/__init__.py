"""Arriving together: one time for all, and the speed or route that meets it."""
