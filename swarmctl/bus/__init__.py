"""The swarm's network: who tells whom what, over which transport, and who may.

Pure: `node` is one UAV's part in it (`reading`: a frame as it is read, `admission`: whether it is of now,
`peer`: another UAV, `replica`: what is held for others, `reach`: whom it speaks to), `backlog` what waits to
be heard, `radio` the model of loss and delay, `access` and `zenoh_config` who may do what on which link,
`keys` the table of all keys. With I/O: `network` puts the nodes of a process on a transport, `memory` or
`zenoh_bus`. `desk` takes operators' commands, `looks` sensors' reports; `open` lets both into a flight in one
process, at an `endpoint` that `directory` finds by the swarm's name.

Imports core; `zenoh` is imported in one file.
"""
