"""One UAV's part in the network, pure: the observations it holds, its requests, what it relays and refuses.

Begin with `node`.
"""
