"""The choice of a route, and the decision to fly it as a new mission.

The package also has splice points, time bounds, travel times, predicted trajectories and fixed-wing landings.
Begin with `decide`.
"""
