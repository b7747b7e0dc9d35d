"""What a measurement says when it lacks something to compare with."""

from spikelane_sim.errors import SpikelaneError


class BenchmarkUnavailableError(SpikelaneError):
    """Something not part of Spikelane is needed and missing; the message says how to get it."""

    exit_status = 1
