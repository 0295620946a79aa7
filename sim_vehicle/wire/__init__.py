"""Columns and messages to frames and back: encoding, streams, telemetry, signing, impaired links. Pure."""
