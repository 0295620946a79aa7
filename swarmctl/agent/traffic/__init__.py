"""Keeping apart: one vehicle's launch, route, landing and return against all others.

`separation` measures distances in space and time; `intents` tells where a vehicle will be; `route_deconfliction`
compares new plans; `collision_avoidance` watches positions; `landing_queue` and `return_turns` decide who waits.
Begin with `separation`, then `collision_avoidance`.
"""
