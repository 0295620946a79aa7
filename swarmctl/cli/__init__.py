"""The command line: one thin file a command, its exit codes, and the only `print` and `exit`.

`registry` has the table of commands, `main` the program. `console` has output and exit codes, and
`configuration` loads configurations. `flights` has the shared parts of commands that fly, `operator_command`
the shared parts of commands to vehicles in flight. Only the called command is imported.
Imports every room; no room imports this one.
Begin with `registry`, then `fly`.
"""
