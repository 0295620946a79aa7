"""The decisions of one vehicle, pure: `step(state, event, now) -> (state, effects)`.

`step` has one handler for each kind of event and calls the parts in order. `state` is the agent's knowledge.
New information only marks the plan dirty. A later `Tick` plans once with all new information.

| part | subject |
|---|---|
| `phases` | the phases of a flight, and which phase may follow which |
| `replan/` | route, and the change of the mission |
| `traffic/` | distance from other vehicles: launch, route, landing, return |
| `arrival/` | simultaneous arrival |
| `formation/` | flight in a group, by set-points |
| `failsafes/` | reactions to failures, one file for each rule |
| `launch`, `given_order`, `flown` | records of the state, each with the changes that it knows |
| `progress` | position of the vehicle on its plan |
| `orders`, `own_modes` | operators' orders; modes that the agent has set |
| `commands`, `restart` | orders to the vehicle; a new start of the program in flight |
| `sharing`, `touchdown` | belief and broadcast state; end of the flight |

Imports core and planners. Begin with `step`.
"""
