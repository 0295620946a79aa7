"""Which route, and whether it is worth a new mission: planning, splicing, time bounds, travel times, landings.

Begin with `decide`.
"""
