"""Separation: the distance between vehicles in space and time, planned, flown and predicted. Pure.

Two vehicles conflict while they are closer than `Limits.horizontal_m` horizontally and closer than
`Limits.vertical_m` vertically. So each vehicle has a cylinder of protected space, as in air traffic control.
Points are (east, north, up) [m], times are by one clock [s].

| module | content |
|---|---|
| `trajectory` | position of a vehicle over time |
| `approach` | closest approach of two trajectories, exact |
| `conflicts` | pairs in conflict among many trajectories |
| `clash` | planned flights that conflict within a tolerance in time |
| `other_vehicles` | last state and known flight of another vehicle, as records |
| `watch` | limits, alarms in flight |

Imports core.
"""
