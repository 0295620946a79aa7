"""MAVLink conversations without I/O: bytes and `now` come in, messages and results come out.

codec: frames and messages; telemetry, statustext, presence, streams: what a vehicle tells; command,
mission_upload, mission_download, wait: single conversations; procedure, procedures: whole jobs made of them;
guarded: commands that are never sent against a pilot;
session: everything of one vehicle; dialects: what differs between autopilots.

Imports core, numpy and pymavlink only: no sockets, no asyncio, no clock.
"""
