"""The numbers of the MAVLink file transfer protocol, and the differences between autopilots."""

from dataclasses import dataclass
from enum import IntEnum


class Opcode(IntEnum):
    """MAV_FTP_OPCODE."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WO = 11
    TRUNCATE_FILE = 12
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class FtpError(IntEnum):
    """MAV_FTP_ERR."""

    FAIL = 1
    FAIL_ERRNO = 2
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


OPENING_OPCODES = frozenset({Opcode.OPEN_FILE_RO, Opcode.CREATE_FILE, Opcode.OPEN_FILE_WO})


@dataclass(frozen=True, slots=True)
class FtpRules:
    """The FTP behaviour of one autopilot."""

    client_names_session: bool  # False: every file is opened in session 0
    another_session: FtpError  # answer to a request outside of the open session
    second_open: FtpError  # answer to an open request while a file is open
    nothing_open: FtpError  # answer to a request that needs an open file
    terminate_needs_open: bool  # True: TERMINATE_SESSION without an open file is an error
    obeys_read_size: bool  # False: the requested size is ignored, data messages are full up to the end
    reports_sizes: bool  # True: answers to CREATE_FILE, OPEN_FILE_WO and WRITE_FILE have a size
    unknown_command: FtpError  # answer to an unsupported opcode
    truncates: bool  # True: TRUNCATE_FILE is supported
    lists_dots: bool  # True: `.` and `..` are listed as entries to skip
    idle_s: float  # idle time [s] after which a session may be replaced (ArduPilot) or is closed (PX4)
    burst_messages: int  # largest number of messages in one burst


ARDUPILOT = FtpRules(
    client_names_session=True,
    another_session=FtpError.INVALID_SESSION,
    second_open=FtpError.FAIL,
    nothing_open=FtpError.FILE_NOT_FOUND,
    terminate_needs_open=False,
    obeys_read_size=True,
    reports_sizes=False,
    unknown_command=FtpError.FAIL,
    truncates=False,
    lists_dots=False,
    idle_s=3.0,
    burst_messages=500,
)
PX4 = FtpRules(
    client_names_session=False,
    another_session=FtpError.INVALID_SESSION,
    second_open=FtpError.NO_SESSIONS_AVAILABLE,
    nothing_open=FtpError.INVALID_SESSION,
    terminate_needs_open=True,
    obeys_read_size=False,
    reports_sizes=True,
    unknown_command=FtpError.UNKNOWN_COMMAND,
    truncates=True,
    lists_dots=True,
    idle_s=10.0,
    burst_messages=147,
)
