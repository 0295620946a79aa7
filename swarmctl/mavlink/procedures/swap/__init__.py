"""Replacing the mission of a flying vehicle: atomic, appended, in hold, or by what is stored already.

Begin with `choice`. Each kind is a machine (`machine`): an enum of states, and a table with the step of each
state and with what may follow.
"""
