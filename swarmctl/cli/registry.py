"""The commands of the program, a file each; they and `cli` alone print and exit.

`register(cli)` adds one. Which file that is, and what `swarmctl --help` says of it, stands here: no command
is imported but the one that is called.
"""

from __future__ import annotations

from collections.abc import Mapping

COMMANDS: Mapping[str, tuple[str, str]] = {
    "fly": ("fly", "Fly the swarm, simulated or real, from the ground to the last landing."),
    "plan": (
        "plan",
        "Plan the first routes for w = 0, 0.5 and 1 without flying: a table, a map and .plan files.",
    ),
    "check": (
        "check",
        "Say everything that is wrong with a configuration, here and now, without starting anything.",
    ),
    "preflight": (
        "preflight",
        "Connect, check every vehicle as `fly` does before it arms, and print what was found; arms nothing.",
    ),
    "set": (
        "set_weights",
        "Change w and the firing strengths of vehicles in flight, from their next plans on.",
    ),
    "observe": (
        "observe",
        "Tell a vehicle in flight what you see: its agent takes it as its own look, and tells the others.",
    ),
    "agent": (
        "agent",
        "Fly one vehicle of the swarm; the others' agents run elsewhere, and tell it what they see.",
    ),
    "watch": (
        "watch",
        "Show where the vehicles of a swarm on many machines are and what they do, until Ctrl-C.",
    ),
    "order": ("order", "Order vehicles flown by `swarmctl agent` to launch, hold, return or land."),
    "abort": (
        "abort",
        "End the flight of vehicles: hold where they are, return, or land where they are.",
    ),
    "router": (
        "router",
        "Route what the agents of a swarm on many machines say, each only what it may, until Ctrl-C.",
    ),
    "keys": (
        "keys",
        "Make a folder of keys for each vehicle, the operator and the router, to be copied to their "
        "machines.",
    ),
    "warm-up": (
        "warm_up",
        "Compile the planners for large areas, once on a machine; small areas need no compiler.",
    ),
    "replay": ("replay", "Fold the recorded events of a run again and say whether the same was decided."),
    "audit": ("audit", "Check the evidence of a run, line by line, and show what happened."),
    "schema": ("schema", "Print the JSON schema of configurations, for editors."),
}
"""name: (file, first paragraph of its help), in the order of the help"""
