"""What a vehicle stores and hands out: MAVLink FTP, flight logs, component metadata. Pure."""
