"""The choice of a route, and whether it is worth a new mission.

Splice points, time bounds, travel times, predicted trajectories and fixed-wing landings belong to it.

Begin with `decide`.
"""
