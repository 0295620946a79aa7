"""The table of commands: file and summary of each command.

A command's file has a function of the file's name, or a Typer application `app` for a command with further
commands. `swarmctl --help` shows the summaries without importing a command.
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
        "Check a configuration and this machine, and list the problems, without a flight.",
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
        "Report an observation to a vehicle in flight; the vehicle's agent uses and shares the observation.",
    ),
    "agent": (
        "agent",
        "Fly one vehicle of the swarm; agents on other machines fly the other vehicles.",
    ),
    "watch": (
        "watch",
        "Show the positions and states of a swarm on many machines, until Ctrl-C.",
    ),
    "order": ("order", "Order vehicles of a running flight to launch, resume, hold, return or land."),
    "abort": (
        "abort",
        "End the flight of vehicles: hold in place, return, or land in place.",
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
        "Compile the planners for large areas, groups and benevolence, once on a machine.",
    ),
    "dashboard": (
        "dashboard",
        "Show a recorded run, a flight in progress, or the results of a study in a browser on this machine.",
    ),
    "replay": ("replay", "Repeat the decisions of a recorded run, and report whether they are the same."),
    "audit": ("audit", "Check the evidence of a run line by line, and summarise it."),
    "study": (
        "study",
        "Fly an experiment of many missions, and draw its figures with intervals.",
    ),
    "schema": ("schema", "Print the JSON schema of configurations, for editors."),
}
"""name: (file, first paragraph of its help), in the order of `swarmctl --help`"""
