"""Separation from other vehicles during launch, route, landing and return. Pure.

| module | acts on | action |
|---|---|---|
| `separation/` | trajectories | distances in space and time; the priority rule |
| `neighbours`, `intents` | messages | stores states and intents of other vehicles; sends the own intent |
| `prediction` | positions | future positions of this vehicle and its neighbours |
| `launching` | first route | waits on the ground |
| `route_deconfliction` | plans, before and while they are flown | another height, another route, or hold |
| `collision_avoidance` | positions, 10 s ahead | hold or climb |
| `landing_queue` | descent at the goal | holds above the landing spot |
| `returning`, `return_schedule` | return path | holds until the path is clear |

Vehicles do not negotiate. All vehicles apply the same rule of priority to the same data, so one of two
vehicles gives way if at least one can. Begin with `separation`, then `collision_avoidance`.
"""
