"""Physics of the fleet as arrays over all vehicles, and `Body`, one vehicle's access to them. Pure."""
