"""The sources of the dashboard, by module.

- `recording`: a recorded run, and the record of a flight in progress; `record_facts` decodes the messages
- `bus`: a swarm of `swarmctl agent` processes
- `mission`: an abstract mission of a study, flown again
- `study`: the results of a study
"""
