"""Experiments by the thousand: missions cell by cell, or whole flights, and figures of their results.

`experiment` reads an experiment file; `levels` makes a configuration of every combination of its factors.
`kinds` has what is computed for each level and seed. `batches` decides what is left to compute, `cluster`
lets processes compute it, and `results` keeps it in a folder. `run` joins them.
Imports core, planners, sensors, bus, agent, config and report; `flights` alone imports flight. Begin with
`run` and `experiment`.
"""
