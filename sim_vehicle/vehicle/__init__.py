"""One vehicle's autopilot: what it knows, decides and answers. Pure: messages and time in, messages out."""
