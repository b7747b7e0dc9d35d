"""The exceptions that Spikelane raises for bad input; commands print them as one line."""


class SpikelaneError(ValueError):
    """Something the user gave is wrong; the message names it, what was expected and what came.

    Attributes:
        exit_status: Of a command that ends because of it: 2, wrong use; 1 for what failed though
            the command was right.
    """

    exit_status = 2


class ParameterError(SpikelaneError):
    """A parameter is unknown, of the wrong type or outside its range."""


class CourseError(SpikelaneError):
    """A course description does not make a course that can be driven."""


class PacketError(SpikelaneError):
    """An event packet cannot be decoded, or events cannot be encoded."""

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
