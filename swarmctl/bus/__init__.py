"""The swarm's bus: who hears whom, over which transport, and how an operator's commands come in.

`keys` is the table of all keys, `network` the model of reach above any transport, `memory` and `zenoh_bus`
the transports. `desk` takes commands and answers them; `open` lets an operator in from other processes, at an
`endpoint` that `directory` finds by the swarm's name. Imports core; `zenoh` is imported in one file.
"""
