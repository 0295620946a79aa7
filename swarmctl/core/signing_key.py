"""The key of MAVLink signing: https://mavlink.io/en/guide/message_signing.html#secret_key"""

KEY_BYTES = 32
