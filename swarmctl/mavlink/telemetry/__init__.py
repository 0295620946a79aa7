"""What a vehicle says: presence, state, text, streams, its mission and its instruments."""
