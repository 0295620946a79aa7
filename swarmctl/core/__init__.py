"""The paper's model and the types that all rooms share: geometry, threats, beliefs, missions, events, frames.

`threat` (Eq. 1), `exposure` (Eq. 2 and 3), `belief` (Eq. 4); `inference` is Bayes beyond Eq. 4; `any_angle`
pulls lattice routes straight. `events` lists the events and effects between agent and runner.
Imports no other room. Only `whole_file` does I/O.
Begin with `grid`, `threat`, `exposure`, `belief`.
"""
