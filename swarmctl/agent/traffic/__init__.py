"""Separation from other vehicles during launch, route, landing and return. Pure.

The modules that act, in the order of a flight. A wait for other vehicles has one deadline, by `wait.RULES`.

| when | module | question | action | at most |
|---|---|---|---|---|
| before the launch | `launching` | Is the first route clear? | waits on the ground | 180 s |
| a new plan | `route_deconfliction` | Is the plan clear, here or higher? | climbs, or keeps its old plan | |
| each message | `route_deconfliction` | Is the flown plan still clear? | a new plan | |
| a hold on the route | `route_hold` | Is the way ahead clear again? | goes on, also higher | 300 s |
| each telemetry | `alarms` | Do two vehicles come too close soon? | reports; climbs, by configuration | |
| each telemetry | `last_resort` | Is this the last moment for a stop? | holds | as the hold |
| over the goal | `landing_queue` | Is the descent clear? | holds above the landing spot | 300 s |
| before a return | `returning` | Is the path home clear? | holds | 120 s |
| a recall | `return_schedule` | When may each vehicle start? | a start time for each | |

The modules that they ask:

| module | answer |
|---|---|
| `neighbours`, `received_intents`, `broadcasts` | the last states and intents received, and sent |
| `prediction` | future positions of this vehicle and its neighbours |
| `known_flights` | the flights of other vehicles that are known now |
| `own_flight` | the own trajectory from now on; `intents` sends it, when it is new, changed, or old |
| `check` | the trajectory check: a flight, the known flights, limits -> the clashes |
| `plan_conflicts` | the record of the clashes of plans, with counts |
| `priority` | the rule of priority: which of two vehicles gives way |
| `wait` | the record of a wait, its deadline, and the function that ends it |
| `separation/` | distances of trajectories in space and time |

One check: launch, new plan, hold, return and landing ask `check` about `known_flights.known_flights`, the
flown plan about `known_intents`. Returns have uncertain speeds and heights, so `return_schedule` also
compares their whole corridors.

One rule: vehicles do not negotiate. All vehicles apply `priority.gives_way` to the same data, so one of two
vehicles gives way if at least one can.

One wait: `AgentState.wait`, made by `wait.begin_wait`, ended by `wait.verdict` or by the end of its phase.
Begin with `check`, `priority` and `wait`.
"""
