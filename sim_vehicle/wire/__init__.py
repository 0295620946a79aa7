"""MAVLink frames of a fleet: encoding, parsing, streams, telemetry, signing, impaired links; no I/O."""
