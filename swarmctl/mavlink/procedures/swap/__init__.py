"""Replacing the mission of a flying vehicle: atomic, appended after the old route, or in hold.

Begin with `choice`.
"""
