"""The facts of the paper, pure: geometry, threats, exposure, beliefs, missions, vehicle state, events.

`threat` (Eq. 1), `exposure` (Eq. 2 and 3), `belief` (Eq. 4); `inference` is Bayes beyond Eq. 4; `any_angle`
pulls lattice routes straight. `events` lists the events and effects between agent and runner.
Imports numpy, scipy, pyproj and msgspec; nothing that does I/O and no other room.
Begin with `grid`, `threat`, `exposure`, `belief`.
"""
