"""The physical side of the fleet, as arrays over all vehicles, and one vehicle's handle on them. Pure."""
