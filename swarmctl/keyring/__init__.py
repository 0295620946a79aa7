"""Who is who in a swarm on many machines: certificates for its links, signatures for its messages.

A folder a participant, to be copied to its machine whole; beside them the swarm's own certificate authority,
whose key stays where the folders were made:

| file | holds |
|---|---|
| `ca/ca.pem`, `ca/key.pem` | the authority; who has its key makes participants |
| `uav3/ca.pem` | the authority's certificate |
| `uav3/cert.pem`, `uav3/key.pem` | a certificate that names `uav3` and its machines, and its private key |
| `uav3/sign.pem` | an Ed25519 private key, with which `uav3` signs what it says |
| `uav3/signers.json` | everybody's public keys, by name, in base64; the same in all folders |

`make` makes them, `use` loads one folder, `files` reads what is in them and says what is wrong with it;
`witness` signs the evidence of a run with them. `mavlink_key` has the key of MAVLink's own signing, which is
another matter. Time is an argument. Imports nothing that opens sockets.
"""
