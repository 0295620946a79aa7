"""The operator's side: find a swarm, send commands, recall vehicles, watch states, run a router.

Imports agent, bus, config, core and report.
Begin with `commands`.
"""
