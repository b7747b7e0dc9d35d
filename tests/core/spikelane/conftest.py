"""What tests of the command share: handlers of signals as they were before each test."""

from collections.abc import Iterator
import signal

import pytest

from spikelane.interruption import SIGNALS


@pytest.fixture(autouse=True)
def _signals_as_before() -> Iterator[None]:
    """Give the test runner its own handlers back, which commands and workers replace."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
