"""Preflight: checks of vehicles and of this computer before a flight. Nothing here arms a vehicle.

`checks` has a file for each check, pure, over `facts`. `policy` has the required parameters of each firmware.
`collection` asks the vehicles for their facts; `conversation` sets them up, runs the checks and applies
`waivers`. `host` checks this computer.
Imports agent, config, core, links and mavlink.
Begin with `checks`.
"""
