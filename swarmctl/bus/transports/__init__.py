"""Transports of the bus: memory, Zenoh with its configuration and access lists, and their repair."""
