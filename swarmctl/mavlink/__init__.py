"""MAVLink conversations without I/O: bytes and `now` come in, messages and results come out.

`protocol`: single conversations (upload, download, command, parameters) and the codec; `telemetry`: what a vehicle
says; `procedures`: whole jobs made of conversations, `procedures.swap` among them; `dialects`: what differs between
autopilots; `session`: everything of one vehicle.
Imports core, numpy and pymavlink: no sockets, no asyncio, no clock.
Begin with `protocol.conversation`, `protocol.procedure` and `session`.
"""
