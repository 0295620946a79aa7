"""Preflight: what has to be so before anything flies. Nothing here arms a vehicle.

`checks` has one check a file, pure, over `facts`; `policy` has the parameters each firmware must have; `conversation`
asks the vehicles and judges; `host` checks this computer; `waivers` are checks that an operator lets fail.
Imports agent, config, core, links and mavlink.
Begin with `checks`.
"""
