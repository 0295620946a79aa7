"""Replacing the mission of a flying vehicle: atomic, appended behind the old route, or in hold.

Begin with `choice`.
"""
