"""Configuration: YAML to a frozen `Scenario`, with errors that name file, line and key.

`model` has the whole schema and `load`; a file a section (`vehicles`, `communication`, `separation`, …), its checks
beside it (`…_checks`); `checks` calls them all; `scenario` builds what is flown; `roster` reads only the vehicles and
endpoints of a swarm; `joining` turns `communication` into a network to join.
Imports agent, bus, core, links.url, planners, preflight.fence and security. Rooms above agent read it; agent,
mavlink and core never do.
Begin with `model` and `scenario`.
"""
