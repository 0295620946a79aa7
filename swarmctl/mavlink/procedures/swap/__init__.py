"""Replacing the mission of a flying vehicle: atomic, appended after the old route, or in hold.

Begin with `choice`. Each kind is a machine (`machine`): an enum of states, and a table with the step of each
state and with what may follow.
"""
