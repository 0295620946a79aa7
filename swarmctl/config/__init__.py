"""Configuration: YAML to a frozen `Scenario`, with errors that name file, line and key.

`model` has the whole schema and `load`. Each section has a file (`vehicles`, `communication`, …), with its
checks beside it (`…_checks`); `checks` calls them all. `scenario` builds the flight. `roster` reads only the
vehicles and endpoints of a swarm. `joining` turns `communication` into the configuration of a network.
`examples` are the shipped configurations, and the starter that `swarmctl init` writes.
Imports core, planners, mavlink, bus, links, security and agent.
Begin with `model` and `scenario`.
"""
