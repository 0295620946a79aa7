"""Sensors: what a vehicle sees where it is. Plug-ins that know the truth or a payload; they import core."""
