"""The example of docs/fleets.md runs, and does what the page says."""

from pathlib import Path
import re
from typing import Any

import numpy as np

PAGE = Path(__file__).parents[4] / 'docs' / 'fleets.md'


def test_the_example_of_the_page_runs() -> None:
    """With fewer steps: 64 robots learn, ten drive laps."""
    (code,) = re.findall(r'^```python\n(.*?)^```', PAGE.read_text('utf-8'), re.M | re.S)
    names: dict[str, Any] = {}
    exec(code.replace('steps=500', 'steps=60'), names)
    assert names['fleet'].steps.shape == (10,)
    assert names['weights_pa'].shape == (2, 32)
    assert np.ptp(names['weights_pa']) > 0.1  # drawn from 200 to 201 pA, and then changed
    assert {state.reason for state in names['last']} == {'laps_complete'}
    assert sorted(names['steps']['robot'].unique()) == list(range(10))
