"""The policy of one vehicle: `step(state, event, now) -> (state, effects)`. Pure.

Nothing here waits, reads a clock or talks to anybody. New information only marks the plan dirty; the next
`Tick` plans once with all of it, and a changed plan becomes one `SwapMission`, of which at most one is under
way. Whatever happens meanwhile waits for its end, and the newest belief wins.

state: what an agent has to do and knows; step: one handler an event; decide: the planning; realise: from a
route to what is flown; bounds: from a time bound to a length; pace: what turns cost; in_time: which route
meets it; branching: where a new plan leaves the old one; swap_times: how long a change takes; stopping: what
it costs who brakes for it; flight_path: where it is when; apart: watching the others; intents: telling where
it will be; clearing: no two plans that meet; over_goal: who waits above there; meeting: arriving with them;
neighbours: what they tell; orders: what operators want; ruling: what the rules of flight demand; launching:
the launch; returning: whose way home is clear; learning: what is seen; sharing: what it tells of itself;
down: whether it is up.
Imports core, planners, rules and separation.
"""

from swarmctl.agent.bounds import AT_ANY_TIME, CLIMB_M_S, Arrival, before_takeoff
from swarmctl.agent.decide import first_flight, first_problem, first_route
from swarmctl.agent.down import is_up
from swarmctl.agent.in_time import arrives_s, bounds_of, misses_by, route_in_time
from swarmctl.agent.launching import in_the_way
from swarmctl.agent.neighbours import concerns
from swarmctl.agent.orders import place_of
from swarmctl.agent.realise import Flown, flown_for, unpulled
from swarmctl.agent.state import ARRIVED, ENDED, IN_FLIGHT, ON_GROUND, AgentState, Phase, Task, begin
from swarmctl.agent.step import MAX_FAILED_SWAPS, RETRY_AFTER_S, step, wants_tick

__all__ = [
    "ARRIVED",
    "AT_ANY_TIME",
    "CLIMB_M_S",
    "ENDED",
    "IN_FLIGHT",
    "MAX_FAILED_SWAPS",
    "ON_GROUND",
    "RETRY_AFTER_S",
    "AgentState",
    "Arrival",
    "Flown",
    "Phase",
    "Task",
    "arrives_s",
    "before_takeoff",
    "begin",
    "bounds_of",
    "concerns",
    "first_flight",
    "first_problem",
    "first_route",
    "flown_for",
    "in_the_way",
    "is_up",
    "misses_by",
    "place_of",
    "route_in_time",
    "step",
    "unpulled",
    "wants_tick",
]
