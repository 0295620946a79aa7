"""The bus: messages between UAVs, operators and payloads, and their transports.

`node` is one UAV's part, without I/O; `transports` are memory and Zenoh; `radio` models range, delay and
loss; `network` connects the nodes of a process to a transport; `keys` has the table of all keys.
`operator_service` receives operators' commands, `external_observations` receives payloads' reports.
Imports core; only one file imports `zenoh`.
Begin with `keys`, then `node.node`.
"""
