"""Evidence of a run: commands, acknowledgements, observed effects on vehicles, and actions of people.

`evidence.jsonl` in the run folder holds one JSON object a line, each with the hash of the previous line. A
changed, removed or inserted line breaks the chain. The last line of a complete file is `closed`.

| key | holds |
|---|---|
| `n` | 0, 1, 2 ... |
| `unix_s`, `run_s` | time by the wall clock, and since the run began [s] |
| `vehicle` | name of the vehicle; null for the whole run |
| `kind` | opened, command, acknowledgement, effect, waiver, operator, note, closed |
| `what` | MAVLink's names and values, or words |
| `previous` | the `hash` of the previous line; 64 zeros in the first line |
| `hash` | SHA-256 of the line without this key, in canonical form |

| module | holds |
|---|---|
| chain | the form of an entry, and the check of a chain; pure |
| traffic, transfer | entries from MAVLink messages and item transfers; pure |
| story | entries from an agent's events and effects; pure |
| digest | the tables of `swarmctl audit`; pure |
| file, disk | the file, and its writing to the disk |
| hooks | the writers: messages on the link, agents, actions of people |
"""
