"""The command line: one thin file for each command, the output, and the exit codes.

`registry` has the table of commands, `main` the program. `console` has output and exit codes, and
`configuration` loads configurations. `flights` has the shared parts of commands that fly, `operator_command`
the shared parts of commands to vehicles in flight. Only the called command is imported.
The command line may import every package; no other package imports the command line.
Begin with `registry`, then `fly`.
"""
