"""The browser's view of a swarm: live, or from a record.

Begin with `picture`, the types of what is shown at one time. `model` makes pictures from what the `sources`
deliver: a recorded run, the record of a flight in progress, the bus, or an abstract mission of a study.
`study_page` shows the results of a study, and `setup_page` edits a configuration on a map.
"""
