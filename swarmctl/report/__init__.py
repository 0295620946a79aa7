"""The output of a flight: record (MCAP), evidence, summary, tables, pictures, plan files.

Imports agent, bus, config, core, mavlink, planners and preflight.
Begin with `record` and `summary`.
"""
