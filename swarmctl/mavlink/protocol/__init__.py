"""Single MAVLink conversations as machines without I/O, and the codec."""
