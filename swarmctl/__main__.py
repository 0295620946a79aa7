"""`python -m swarmctl`, equal to the command `swarmctl`."""

from swarmctl.cli.entry import main

main()
