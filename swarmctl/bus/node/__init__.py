"""One UAV's part in the network, pure: what it holds, asks for, passes on and refuses.

Begin with `node`.
"""
