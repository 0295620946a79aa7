"""What a MAVLink frame is made of, as far as it is looked at without a codec."""

MAVLINK1, MAVLINK2 = 0xFE, 0xFD  # the first byte
HEADER1_BYTES, HEADER2_BYTES = 6, 10  # with the first byte, up to the payload


def header_bytes(frame: bytes) -> int:
    """How long the header of a frame is."""
    return HEADER2_BYTES if frame[:1] == bytes([MAVLINK2]) else HEADER1_BYTES
