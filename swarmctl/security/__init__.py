"""Keys and signatures: certificates of links, signers of messages, signed requests, keys of evidence.

A folder a participant, to be copied to its machine whole; beside them the swarm's own certificate authority,
whose key stays where the folders were made:

| file | holds |
|---|---|
| `ca/ca.pem`, `ca/key.pem` | the authority; its key makes participants |
| `uav3/ca.pem` | the authority's certificate |
| `uav3/cert.pem`, `uav3/key.pem` | a certificate that names `uav3` and its machines, and its private key |
| `uav3/sign.pem` | the Ed25519 private key that signs what `uav3` says |
| `uav3/signers.json` | everybody's public keys, by name, in base64; the same in all folders |

Imports core and bus; opens no sockets. Time is an argument.
Begin with `issue` and `participant`.
"""
