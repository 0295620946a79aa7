"""A conformance suite for MAVLink autopilots: named checks against one vehicle at a URL.

`registry` holds the checks, `checks/` has them one file a category, `peer` is the ground station they speak
through, `guard` what it never sends, `dialects` what each autopilot is known to do where the specification
leaves it open, `runner` runs them and `report` tells. Only `sockets` does I/O and reads a clock; against a
`Fleet` (`virtual`) the same checks run on simulated time.
"""
