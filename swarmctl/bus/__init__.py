"""The bus: messages between UAVs, operators and payloads, and their transports.

`node` is one UAV's part, pure; `transports` are memory and Zenoh; `radio` models range, delay and loss;
`network` puts the nodes of a process on a transport; `keys` has the table of all keys. `operator_service`
takes operators' commands, `external_observations` takes payloads' reports.
Imports core; `zenoh` is imported in one file.
Begin with `keys`, then `node.node`.
"""
