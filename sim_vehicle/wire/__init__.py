"""From columns and messages to frames and back: encoding, streams, telemetry, signing, spoilt wires. Pure."""
