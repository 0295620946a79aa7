"""`python -m swarmctl`: the same as the console script."""

from swarmctl.cli.entry import main

main()
