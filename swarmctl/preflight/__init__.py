"""Preflight: checks of vehicles and of this computer before a flight. Nothing here arms a vehicle.

| module | contents |
|---|---|
| `checks`, `facts` | one file for each check; the facts that the checks read |
| `policy`, `declared` | required parameters of each firmware; declared behaviour of each vehicle |
| `inspection` | the procedures on one vehicle: correction of parameters, and the questions for its facts |
| `collection`, `conversation` | collection of the facts; set-up of all vehicles and rounds of checks |
| `results`, `waivers`, `report` | results, accepted failures, tables |
| `host` | checks of this computer |

Imports agent, bus, config, core, links and mavlink. Begin with `checks`.
"""
