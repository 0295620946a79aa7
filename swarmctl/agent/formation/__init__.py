"""Formation flight: a group's members, their set-points, and the laws of the three approaches. Pure.

| part | subject |
|---|---|
| `shape` | the places of a group's members |
| `reference` | the group's route as a smooth curve, with a speed at each distance |
| `approaches/` | one file for each approach: what a member does now, by what the members told |
| `membership` | the group as one vehicle knows it |
| `ways`, `split` | places on ways of their own, and the leader's choice to split |
| `presence`, `near_members` | present members, leader and route |
| `view` | the group as one of its members sees it, for an approach |
| `flight` | joining, set-points, the leader's speed, and leaving |
| `group_planner`, `group_plan` | the leader's planner, and new routes in flight |
| `member_messages`, `trajectory` | messages to the members; the predicted flight |

Imports core, planners and parts of traffic. Begin with `flight`.
"""
