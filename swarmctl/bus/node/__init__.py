"""One UAV's part in the network, without I/O: its observations, requests, relayed and refused messages.

Begin with `node`.
"""
