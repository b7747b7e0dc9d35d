"""How a run's setting is told from the paper's."""

from pathlib import Path
from typing import Any

import pytest

from spikelane.report.settings import setting_of
from spikelane.runs.configuration import Request
from spikelane.runs.evaluate.config import EvaluateConfig
from spikelane.runs.lap.config import LapConfig


@pytest.mark.parametrize(
    ('parameters', 'setting'),
    [
        ({}, ''),
        ({'simulator.episode.max_steps': 900}, 'episode.max_steps 900'),
        ({'simulator.camera.antialias': True}, 'camera.antialias True'),
    ],
)
def test_the_limits_of_laps_are_no_setting_unless_given(
    parameters: dict[str, Any], setting: str
) -> None:
    """Every lap and evaluation has a time limit, and ends where the robot makes no progress."""
    asked = Request('1', 'braitenberg', parameters=parameters)
    for config in (LapConfig.make(asked), EvaluateConfig.make(asked, {})):
        written = {**config.to_dict(), 'given': dict(config.given)}
        assert setting_of(written, Path('runs/lap')).setting == setting
