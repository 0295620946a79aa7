"""The commands of the program, a file each; `register(cli)` adds one. They and `cli` alone print and exit."""
