"""One flight: composition root, task tree, runner, director, shutdown, the simulator process.

`app` flies a `Scenario`: `run` fixes the facts, `resources` opens files and links, `wiring` builds the
members and their director, `task_tree` runs all tasks, and `app` returns the report.
`runner` carries events to one agent and performs its effects. `director` prepares and launches the vehicles.
`shutdown` and `emergency` return or land the vehicles.
Imports every room but cli and station. Begin with `app`, then `runner`.
"""
