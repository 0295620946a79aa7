"""The decisions of one vehicle, pure: `step(state, event, now) -> (state, effects)`.

`step` has one handler for each event and calls the parts in order. `state` is the agent's whole knowledge.
New information only marks the plan dirty. The next `Tick` plans once with all new information.

| part | decision |
|---|---|
| `replan/` | route, and the change of the mission |
| `traffic/` | distance from other vehicles: launch, route, landing, return |
| `arrival/` | simultaneous arrival |
| `failsafes/` | one file for each rule |
| `orders`, `own_modes` | operators' orders; modes that the agent has set |
| `sharing`, `touchdown` | belief and broadcast state; end of the flight |

Imports core and planners. Begin with `step`.
"""
