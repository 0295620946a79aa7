"""Separation from other vehicles during launch, route, landing and return. Pure.

| module | acts on | action |
|---|---|---|
| `separation/` | trajectories | distances in space and time |
| `known_flights` | states and intents received | which flights of other vehicles are known now |
| `check` | flights | the trajectory check: a flight, the known flights, limits -> the clashes |
| `priority` | two vehicles | the rule of priority, a table |
| `wait` | one wait | its record, its deadline, and the function that ends it; a table of all waits |
| `neighbours`, `received_intents` | messages | stores states and intents of other vehicles |
| `own_flight` | phase, plan, order | the own trajectory from now on |
| `intents` | own trajectory | sends it, when it is new, changed, or old |
| `prediction` | positions | future positions of this vehicle and its neighbours |
| `launching` | first route | waits on the ground |
| `route_deconfliction` | plans, before and while they are flown | another height, another route, or hold |
| `route_hold` | a hold on the route | its begin, its end, the heights that it may go on at |
| `alarms` | positions, `look_ahead_s` ahead | reports a conflict; climbs, if the vehicle gives way so |
| `landing_queue` | descent at the goal | holds above the landing spot |
| `returning`, `return_schedule` | return path | holds until the path is clear |
| `last_resort` | plans and velocities, `look_ahead_s` ahead | stops a copter in time |

One check: launch, new plan, hold, return and landing ask `check` about `known_flights.known_flights`, the
flown plan about `known_intents`. Returns have uncertain speeds and heights, so `return_schedule` also
compares their whole corridors.

One rule: vehicles do not negotiate. All vehicles apply `priority.gives_way` to the same data, so one of two
vehicles gives way if at least one can.

One wait: `AgentState.wait`, made by `wait.begin_wait`, ended by `wait.verdict` or by the end of its phase.
Launch, route, descent, return path and turn in a recall are its purposes.

Begin with `check`, `priority` and `wait`.
"""
