"""Configuration: YAML to a frozen `Scenario`, with errors that name file, line and key.

`model` has the whole schema and `load`. Each section has a file (`vehicles`, `communication`, …); its checks
are in a second file (`…_checks`). `checks` calls all checks. `scenario` builds the flight. `roster` reads
only the vehicles and endpoints of a swarm. `joining` turns `communication` into the configuration of a
network. `examples` finds the shipped configurations, and writes the starter of `swarmctl init`.
Imports core, planners, mavlink, bus, links, security and agent.
Begin with `model` and `scenario`.
"""
