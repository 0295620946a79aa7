"""Separation from other vehicles during launch, route, landing and return. Pure.

| module | acts on | action |
|---|---|---|
| `separation/` | trajectories | distances in space and time; the priority rule |
| `neighbours`, `intents` | messages | stores what others broadcast; sends the own intent |
| `prediction` | positions | where this vehicle and its neighbours will be |
| `launching` | first route | waits on the ground |
| `route_deconfliction` | plans, before and while they are flown | another height, another route, or hold |
| `collision_avoidance` | positions, 10 s ahead | hold or climb |
| `landing_queue` | descent at the goal | holds above the landing spot |
| `returning`, `return_schedule` | way home | holds until the path is clear |

No vehicle negotiates: each applies the same rule of priority to the same data, so exactly one of two gives
way. Begin with `separation`, then `collision_avoidance`.
"""
