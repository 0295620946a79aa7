"""Formation flight: shapes, the reference that a group follows, and the laws of the three approaches. Pure.

| part | subject |
|---|---|
| `shape` | the places of a group's members |
| `reference` | the group's route as a smooth curve, with a speed at each distance |
| `approaches/` | one file for each approach: what a member does now, by what the members told |

Imports core and planners. Begin with `approaches.base`.
"""
