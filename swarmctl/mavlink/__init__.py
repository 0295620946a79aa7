"""MAVLink conversations without I/O: bytes and `now` come in, messages and results come out.

codec: frames and messages; telemetry, statustext, presence, streams: what a vehicle tells; command,
mission_upload, mission_download, mission_append, mission_current, wait: single conversations; procedure,
procedures: whole jobs made of them, the longer ones in launching and swapping (swap_at_once, swap_behind,
swap_in_place), with steps they share in placing, making_current, swap_steps, where a vehicle is on its new
route in way_ahead, and their ends in outcome;
guarded: commands that are never sent against a pilot;
session: everything of one vehicle; dialects: what differs between autopilots.

Imports core, numpy and pymavlink only: no sockets, no asyncio, no clock.
"""
