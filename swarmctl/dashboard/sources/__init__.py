"""The sources of the dashboard: a recorded run, the record of a flight in progress, and the bus."""
