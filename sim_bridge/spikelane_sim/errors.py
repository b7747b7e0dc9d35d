"""The exceptions that Spikelane raises for bad input; commands print them as one line."""


class SpikelaneError(ValueError):
    """Something the user gave is wrong; the message names it, what was expected and what came."""


class ParameterError(SpikelaneError):
    """A parameter is unknown, of the wrong type or outside its range."""


class CourseError(SpikelaneError):
    """A course description does not make a course that can be driven."""


class PacketError(SpikelaneError):
    """An event packet cannot be decoded, or events cannot be encoded."""


class BagError(SpikelaneError):
    """A bag cannot be read or written."""
