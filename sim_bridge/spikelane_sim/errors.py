"""The exceptions that Spikelane raises for bad input; commands print them as one line."""


def one_line(text: str) -> str:
    """Return a text with names of others in it as one line that can be printed everywhere."""
    if text.isprintable():
        return text
    return ''.join(
        each if each.isprintable() else ' ' if each.isspace() else '\ufffd' for each in text
    )


class SpikelaneError(ValueError):
    """Something the user gave is wrong; the message names it, what was expected and what came.

    The message is made one line, whatever is in the names and values that it has from files.

    Attributes:
        exit_status: Status of a command that ends with it: 2 for wrong use, 1 for what failed
            though the command was right.
    """

    exit_status = 2

    def __init__(self, message: str = '') -> None:
        """Keep the message."""
        super().__init__(one_line(message))


class ParameterError(SpikelaneError):
    """A parameter is unknown, of the wrong type or outside its range."""


class CourseError(SpikelaneError):
    """A course description does not make a course that can be driven."""


class PacketError(SpikelaneError):
    """An event packet cannot be decoded, or events cannot be encoded."""

    exit_status = 1


class PoseError(SpikelaneError):
    """The robot cannot be where it is to be placed."""


class MessageError(SpikelaneError):
    """A field of a message has a value that is not allowed."""

    exit_status = 1


class BagError(SpikelaneError):
    """A bag cannot be read or written."""

    exit_status = 1


class CheckpointError(SpikelaneError):
    """A checkpoint cannot be read, or what it holds cannot be used."""

    exit_status = 1


class CheckpointChoiceError(CheckpointError):
    """The checkpoint given is none, or that of something else."""

    exit_status = 2
