"""Transports of the bus: memory, and Zenoh with its configuration, access lists and session renewal.

A transport fits `base.Transport`. `swarmctl.flight.wiring.open_resources` opens the one that
`communication.bus` names, or takes an open one.
"""
