"""Frame layout of MAVLink, for code that reads frames without a codec."""

MAVLINK1, MAVLINK2 = 0xFE, 0xFD  # first byte of a frame
HEADER1_BYTES, HEADER2_BYTES = 6, 10  # header length including the first byte


def header_bytes(frame: bytes) -> int:
    """Return the header length of a frame."""
    return HEADER2_BYTES if frame[:1] == bytes([MAVLINK2]) else HEADER1_BYTES
