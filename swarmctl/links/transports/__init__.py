"""Bytes on the wire: UDP, TCP, serial, and memory for a virtual clock."""
