"""Keys and signatures: certificates of links, signers of messages, signed requests, keys of evidence.

Each participant has a folder, to be copied to its machine as a whole. Beside them is the swarm's certificate
authority, whose key stays on the machine where the folders were made:

| file | holds |
|---|---|
| `ca/ca.pem`, `ca/key.pem` | the authority, and its key for making participants |
| `uav3/ca.pem` | the authority's certificate |
| `uav3/cert.pem`, `uav3/key.pem` | a certificate that names `uav3` and its machines, and its private key |
| `uav3/sign.pem` | the Ed25519 private key of `uav3`'s signatures |
| `uav3/signers.json` | the public keys of all participants by name, in base64; the same in all folders |

Imports core and bus; opens no sockets. Time is an argument.
Begin with `issue` and `participant`.
"""
