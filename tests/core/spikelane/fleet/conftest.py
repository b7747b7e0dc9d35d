"""What the tests of fleets share."""

import pytest

from spikelane.fleet import setting


@pytest.fixture(autouse=True)
def _short_runs_are_worth_a_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what is short enough for a test be driven in a kernel, too."""
    monkeypatch.setattr(setting, 'LEAST_STEPS', 0)
