"""Physics of the fleet as arrays over all vehicles. `Body` is one vehicle's access to these arrays."""
