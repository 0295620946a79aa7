"""The process around a fleet: pace, ports, options, table, logs.

Only `serving` and `links` have sockets and clocks. Begin with `serve.serve` and `server.Server`.
"""
