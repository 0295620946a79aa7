"""Transports of the bus: memory, and Zenoh with its configuration, access lists and session renewal."""
