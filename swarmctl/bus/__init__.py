"""The swarm's bus: who hears whom, over which transport.

`keys` is the table of all keys, `network` the model of reach above any transport, `memory` and `zenoh` the
transports. Imports core; `zenoh` is imported in one file, `bus/zenoh_bus.py`.
"""
