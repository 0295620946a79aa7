"""Faults that make failsafes act."""

from __future__ import annotations

from trouble import Trouble


def sagging(share: float) -> Trouble:
    """Return a fault that limits the second vehicle's charge to this share after 30 s."""
    params = {"at_most": share, "sag_v": 0.0}
    return Trouble(faults=[{"fault": "battery_sag", "params": params, "vehicles": [2], "at_s": 30.0}])


def outage(for_s: float) -> Trouble:
    return Trouble(faults=[{"fault": "link_outage", "vehicles": [2], "at_s": 30.0, "for_s": for_s}])
