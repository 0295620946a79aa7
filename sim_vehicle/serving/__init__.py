"""The process around the fleet: pace, ports, options, table, logs of a run.

Here and in `links` are the only sockets and clocks.
"""
