"""The operator's side: find a swarm, ask, order, recall, watch, route.

Imports bus, config, core, report and security.
Begin with `client`.
"""
