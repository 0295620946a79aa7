"""Evidence of a run: what was commanded, waived and ordered, as a chain of lines over the other files.

`evidence.jsonl` in the run folder holds one JSON object a line, each with the hash of the previous line. A
changed, removed or inserted line breaks the chain. The last line of a complete file is `closed`: it has the
hashes of `run.mcap` and the tlogs, and the signature. Vehicles' answers and states are in those files.

| key | holds |
|---|---|
| `n` | 0, 1, 2 ... |
| `unix_s`, `run_s` | time by the wall clock, and since the run began [s] |
| `vehicle` | name of the vehicle; null for the whole run |
| `kind` | opened, command, waiver, operator, note, closed |
| `what` | MAVLink's names and values, or words; null for NaN |
| `previous` | the `hash` of the previous line; 64 zeros in the first line |
| `hash` | the first key: SHA-256 of the line's bytes without this key and the line end |

| module | holds |
|---|---|
| chain | the form of a line, and the check of a chain; pure |
| commands | the content of a line about a message to a vehicle; pure |
| log | the writer: messages, orders and waivers, and the hashes of the other files |
| digest | the tables of `swarmctl audit`, from the chain and the tlogs; pure |
"""
