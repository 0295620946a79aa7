"""Transports of the bus: memory, and Zenoh with its configuration, access lists and session renewal.

Every transport implements `base.Transport`. `swarmctl.flight.wiring.open_resources` opens the transport that
`communication.bus` names.
"""
