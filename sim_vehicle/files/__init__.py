"""Files of a vehicle: MAVLink FTP, flight logs, component metadata. Begin with `filesystem`."""
