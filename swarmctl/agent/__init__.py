"""The decisions of one vehicle, pure: `step(state, event, now) -> (state, effects)`.

`step` has one handler an event and names the parts in the order in which they act; `state` has what an agent knows and
does. `replan` chooses routes, `traffic` keeps vehicles apart, `arrival` brings them to the goal together, `failsafes`
has one file a rule. New information only marks the plan dirty; the next `Tick` plans once with all of it.
Imports core and planners.
Begin with `step`.
"""
