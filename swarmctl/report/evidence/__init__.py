"""Evidence: what was commanded, what the vehicles answered and were seen to do, and what people did.

`evidence.jsonl` in the run folder: one JSON object a line, each with the hash of the line before, so that a
line that is changed, taken out or put in breaks the chain there.

| key | holds |
|---|---|
| `n` | 0, 1, 2 ... |
| `unix_s`, `run_s` | when, by the wall clock and since the run began [s] |
| `vehicle` | its name; null for the whole run |
| `kind` | opened, command, acknowledgement, effect, waiver, operator, note, closed |
| `what` | MAVLink's names and values, or words |
| `previous` | the `hash` of the line before; 64 zeros in the first |
| `hash` | SHA-256 of the line without this key, in canonical form |

chain: the form and its check; traffic: from MAVLink messages to entries; transfer:
the items among them; story: from an agent's events to
entries; digest: what `swarmctl audit` tells. All of them pure. book: the file; disk: how it outlives a loss
of power; hooks: who writes into it.
"""
