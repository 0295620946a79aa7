"""Files of a vehicle: MAVLink FTP, flight logs, component metadata. Pure; begin with `vehicle_files`."""
