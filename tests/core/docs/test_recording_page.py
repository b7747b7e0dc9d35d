"""The page on recordings: its Python runs as it stands there."""

from __future__ import annotations

from pathlib import Path
import re
from typing import Any

import matplotlib
import pytest

from spikelane_controllers.registry import cards, make_controller
from spikelane_controllers.shown import shown_by

PAGE = (Path(__file__).parents[3] / 'docs/recording.md').read_text('utf-8')


def test_the_code_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One block after the other; Neo and pandas see the same spikes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(matplotlib, 'backend_fallback', 'agg', raising=False)
    matplotlib.use('agg')
    blocks = re.findall(r'^```python\n(.*?)^```', PAGE, re.M | re.S)
    assert len(blocks) == 4
    names: dict[str, Any] = {'__name__': 'page'}
    for block in blocks:
        exec(compile(block, 'recording.md', 'exec'), names)
    trains, data = names['trains'], names['data']
    assert [each.name for each in trains] == ['left', 'right']
    assert sum(map(len, trains)) == data.sizes['spikes'] > 5000
    assert names['potentials'].shape == (50 * data.sizes['step'], 2)
    assert len(names['weights']) == data['weights'].size
    data.close()


def test_the_table_names_what_each_controller_offers() -> None:
    """All quantities, and no others."""
    rows = re.findall(r'^\| `(\w+)` \|(.*?)\|(.*?)\|(.*?)\|.*\|.*\|$', PAGE, re.M)
    said = {
        name: {quantity for quantity, *cells in rows if cells[column].strip()}
        for column, name in enumerate(('braitenberg', 'rstdp', 'dqn_snn'))
    }
    offered = {
        name: {each.name for each in shown_by(make_controller(name)).quantities}
        for name in cards()
    }
    assert {name: found for name, found in offered.items() if found} == said
