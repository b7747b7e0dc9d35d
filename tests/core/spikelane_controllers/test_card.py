"""A controller owns itself: nothing outside its folder names it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
import re

import pytest

from spikelane_controllers.registry import card, cards, controller_names, usual_training

ROOT = Path(__file__).parents[3]
CONTROLLERS = ROOT / 'controllers/spikelane_controllers'
OWN = ('braitenberg', 'dqn', 'dqn_snn', 'rstdp')
_NAME = re.compile(rf'({"|".join(OWN)})([.,].*)?')
_MODULE = re.compile(rf'spikelane_controllers\.({"|".join(OWN)})(?:\.|$)')


def modules() -> list[Path]:
    """Return all modules outside the controllers' folders."""
    folders = (ROOT / 'sim_bridge', ROOT / 'controllers', ROOT / 'ros2_ws/src/spikelane')
    own = {CONTROLLERS / name for name in OWN}
    return [
        path
        for folder in folders
        for path in sorted(folder.rglob('*.py'))
        if path.name != 'setup.py' and not own & {path, *path.parents}
    ]


def named_in(path: Path) -> Iterator[str]:
    """Yield the texts and imports by which a module names a controller."""
    for node in ast.walk(ast.parse(path.read_text('utf-8'))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            if _NAME.fullmatch(node.value):
                yield f'{node.lineno}: {node.value!r}'
        elif isinstance(node, ast.ImportFrom) and _MODULE.match(node.module or ''):
            yield f'{node.lineno}: import of {node.module}'


def test_the_controllers_are_those_that_have_a_folder() -> None:
    """Each with its card."""
    found = sorted(path.parent.name for path in CONTROLLERS.glob('*/card.py'))
    assert found == sorted(OWN)
    assert set(OWN) <= set(controller_names())


@pytest.mark.parametrize('path', modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_no_other_module_names_a_controller(path: Path) -> None:
    """Not by a text, nor by an import."""
    assert list(named_in(path)) == []


@pytest.mark.parametrize('name', OWN)
def test_a_controller_imports_none_but_the_one_whose_policy_it_takes_over(name: str) -> None:
    """What two controllers share is in `spiking` or `learning`."""
    transfer = card(name).transfer
    allowed = {name, transfer.source} if transfer else {name}
    imported = {
        found[1]
        for path in (CONTROLLERS / name).rglob('*.py')
        for node in ast.walk(ast.parse(path.read_text('utf-8')))
        if isinstance(node, ast.ImportFrom) and (found := _MODULE.match(node.module or ''))
    }
    assert imported <= allowed


def test_a_name_is_found(tmp_path: Path) -> None:
    """So that the test above can fail."""
    file = tmp_path / 'module.py'
    file.write_text("x = 'rstdp.learning'\nfrom spikelane_controllers.dqn.card import CARD\n")
    assert set(named_in(file)) == {
        "1: 'rstdp.learning'",
        '2: import of spikelane_controllers.dqn.card',
    }


def test_one_controller_is_the_usual_one_and_one_is_usually_trained() -> None:
    """Commands take them where none is asked for."""
    assert [name for name, each in cards().items() if each.is_usual] == ['braitenberg']
    assert usual_training() == 'rstdp'
    training = card('rstdp').training
    assert training is not None
    assert training.defaults['simulator.episode.max_distance_m'] == 0.2  # paper section 4.4
