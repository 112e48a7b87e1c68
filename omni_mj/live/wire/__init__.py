"""Messages of the RoboCup Small Size League: SSL-Vision and ssl-simulation-protocol.

`league.proto` holds the field numbers; `make proto` generates the module `league_pb2` from it.
Vision lengths are in mm on the wire and in m everywhere else.
"""

from typing import TypeVar

from google.protobuf.message import DecodeError, Message

from omni_control.errors import OmniError

MM_PER_M = 1000.0
# Default ports of simulators. SSL-Vision itself sends to port 10006.
VISION_PORT = 10020
BLUE_PORT, YELLOW_PORT = 10301, 10302

MessageT = TypeVar("MessageT", bound=Message)


class WireError(OmniError):
    """Bytes that are not a message of the expected type."""


def parse_message(message_type: type[MessageT], data: bytes) -> MessageT:
    """Return the message that `data` encodes.

    Raises:
        WireError: The bytes are malformed, or a required field is missing.
    """
    message = message_type()
    try:
        message.ParseFromString(data)
    except DecodeError as error:
        raise WireError(f"{message_type.__name__}: {error}") from None
    if not message.IsInitialized():
        missing_fields = ", ".join(message.FindInitializationErrors())
        raise WireError(f"{message_type.__name__} lacks {missing_fields}")
    return message
