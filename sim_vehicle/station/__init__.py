"""A ground station without I/O, which flies scenarios and the vehicles under test.

`client` follows a script; `exchanges` are its conversations with one vehicle. No sockets, no clock.
"""
