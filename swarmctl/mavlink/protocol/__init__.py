"""Single MAVLink conversations as state machines without I/O, and the codec."""
