"""A ground station without sockets and clocks, for scenarios and for vehicles under test.

`client` runs a script; `exchanges` has the requests to one vehicle.
"""
