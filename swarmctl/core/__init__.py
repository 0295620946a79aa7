"""Facts, pure: geometry, threats, beliefs, exposure, missions, vehicle state, and the words agents use.

Imports numpy, scipy, pyproj and msgspec; nothing that does I/O, and nothing else of swarmctl.
"""
