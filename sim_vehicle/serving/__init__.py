"""The process around a fleet: pace, ports, options, table, logs.

Only this room and `links` have sockets and clocks. Begin with `serve.serve` and `server.Server`.
"""
