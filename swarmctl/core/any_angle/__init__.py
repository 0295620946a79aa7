"""Routes off the lattice: straight legs in place of 45° turns, turn radii, and exposure along a track."""
