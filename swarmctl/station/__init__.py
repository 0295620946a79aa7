"""The operator's side: find a swarm, send commands, recall vehicles, watch states, run a router.

Imports bus, config, core, report and security.
Begin with `client`.
"""
