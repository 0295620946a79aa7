"""Configuration: YAML to a frozen `Scenario`, with errors that name file, line and key.

`model` has the whole schema and `load`. Most sections have a file, such as `communication`, and some sections
have a file of checks, such as `communication_checks`. `checks` calls all checks. `scenario` builds a flight.
`roster` has the part of the schema that orders need: the vehicles, the area and the network of a swarm.
`joining` turns `communication` into the configuration of a network. `examples` finds the shipped
configurations, and writes the starter of `swarmctl init`.
Imports core, planners, mavlink, bus, links, security and agent.
Begin with `model` and `scenario`.
"""
