"""One flight: composition root, task tree, runner, director, shutdown, the simulator process.

`app` builds everything from a `Scenario`. `runner` carries events to one agent and performs its effects.
`director` prepares and launches the vehicles. `shutdown` and `emergency` return or land the vehicles.
Imports every room but cli and station. Begin with `app`, then `runner`.
"""
