"""What UAVs tell each other, over which transport, and who may.

`node` is one UAV's part, pure; `transports` are memory and Zenoh; `radio` models range, delay and loss; `network` puts
the nodes of a process on a transport; `keys` has the table of all keys. `operator_service` takes operators' commands,
`external_observations` sensors' reports.
Imports core; `zenoh` is imported in one file.
Begin with `keys`, then `node.node`.
"""
