"""The process around a fleet: pace, ports, options, table, logs.

Begin with `serve.serve` and `server.Server`.
"""
