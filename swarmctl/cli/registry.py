"""The table of commands: the file of each, and its summary in `swarmctl --help`.

A command's file has `register(cli)`. The summaries stand here, so that only the called command is imported.
"""

from __future__ import annotations

from collections.abc import Mapping

COMMANDS: Mapping[str, tuple[str, str]] = {
    "fly": ("fly", "Fly the swarm, simulated or real, from the ground to the last landing."),
    "plan": (
        "plan",
        "Plan the first routes for w = 0, 0.5 and 1 without flying: a table, a map and .plan files.",
    ),
    "init": ("init", "Write a starter configuration with comments, for simulated or real vehicles."),
    "check": (
        "check",
        "Check a configuration and this machine, and list every problem, without a flight.",
    ),
    "preflight": (
        "preflight",
        "Run the preflight checks of `fly` on every vehicle and print the results, without arming.",
    ),
    "set": (
        "set_weights",
        "Change w and the firing strengths of vehicles in flight, from their next plans on.",
    ),
    "observe": (
        "observe",
        "Report an observation to a vehicle in flight; its agent handles it as its own and shares it.",
    ),
    "agent": (
        "agent",
        "Fly one vehicle of the swarm, with the others flown by agents on other machines.",
    ),
    "watch": (
        "watch",
        "Show the positions and states of a swarm on many machines, until Ctrl-C.",
    ),
    "order": ("order", "Order vehicles in flight to launch, hold, return or land."),
    "abort": (
        "abort",
        "End the flight of vehicles: hold where they are, return, or land where they are.",
    ),
    "router": (
        "router",
        "Route the messages of a swarm on many machines, with access control, until Ctrl-C.",
    ),
    "keys": (
        "keys",
        "Make a folder of keys for each vehicle, the operator and the router, to copy to their machines.",
    ),
    "warm-up": (
        "warm_up",
        "Compile the planners for large areas, once on a machine; small areas need no compiler.",
    ),
    "replay": ("replay", "Repeat the decisions of a recorded run, and report whether they are the same."),
    "audit": ("audit", "Check the evidence of a run line by line, and summarise it."),
    "schema": ("schema", "Print the JSON schema of configurations, for editors."),
}
"""name: (file, first paragraph of its help), in the order of `swarmctl --help`"""
