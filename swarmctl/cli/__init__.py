"""The command line: one thin file a command, its exit codes, and the only `print` and `exit`.

`registry` has the table of commands, `main` the program, `console` what commands share. Only the command that is
called is imported. Imports every room; nothing imports this one.
Begin with `registry`, then `fly`.
"""
