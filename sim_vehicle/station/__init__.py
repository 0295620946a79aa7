"""A ground station without sockets and clocks, which flies scenarios and the vehicles under test.

`client` runs a script; `exchanges` has the requests to one vehicle.
"""
