"""Keys and signatures: certificates of bus links, keys for messages, signed requests, tokens, evidence.

Each participant has a folder. The user copies the whole folder to the participant's machine. A further folder
has the swarm's certificate authority. The authority's key stays on the machine where the folders were made:

| file | contents |
|---|---|
| `ca/ca.pem`, `ca/key.pem` | the authority's certificate, and the key that signs all certificates |
| `uav3/ca.pem` | the authority's certificate |
| `uav3/cert.pem`, `uav3/key.pem` | a certificate for `uav3` and its hosts, and the private key |
| `uav3/sign.pem` | the Ed25519 private key of `uav3`'s signatures |
| `uav3/signers.json` | the public keys of all participants by name, in base64; the same in all folders |
| `revoked.json`, `uav3/revoked.json` | the revoked certificates and public keys by name; all the same |
| `ca/swarms.json` | the names of the swarms that use these keys |

Imports core and bus; opens no sockets. Time is an argument.
Begin with `issue` and `participant`.
"""
