"""MAVLink conversations without I/O: messages and times go in, messages and results come out.

| module | contents |
|---|---|
| `protocol` | single conversations (upload, download, command, parameters) and the codec |
| `telemetry` | presence, state, texts, streams, mission and instruments of a vehicle |
| `procedures` | sequences of conversations: launch, land, `procedures.swap` |
| `dialects` | differences between autopilots |
| `session`, `events` | session of one vehicle, which joins all these modules; events of a session |

Imports core and pymavlink; uses no sockets, no asyncio and no clock.
Begin with `protocol.conversation`, `protocol.procedure` and `session`.
"""
