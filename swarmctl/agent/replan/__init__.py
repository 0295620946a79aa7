"""The choice of a route, and the decision to fly it as a new mission.

Begin with `decide`. The files in the order of a decision:

| file | question |
|---|---|
| `mission_changes` | Is a new plan due? What follows from the outcome of a mission change? |
| `decide` | Which route is best now, and is it worth a new mission? |
| `splice` | Where may a new route leave the present one? |
| `time_bound`, `length_bounds`, `spare_time` | How long may the route be, by the time bound? |
| `travel_time`, `stopping`, `climb`, `swap_times` | How long does the flight take, and the mission change? |
| `route_to_mission`, `landing`, `landing_pattern` | Which mission items fly the route? |
| `copter_trajectory`, `wing_trajectory` | Where will the vehicle be at each time, by that mission? |
| `stored_mission` | Can the vehicle go on by the mission that it has left? |

Words: the *splice point* is the place where a new route leaves the present one. The *lead-in* is the flight
to the first cell of the new route. The *departure* is how the vehicle leaves: its speed, its path to the
splice point, and the cost of the mission change. A *track* is a straightened route.
"""
