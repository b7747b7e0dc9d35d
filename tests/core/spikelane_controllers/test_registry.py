"""Controllers by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
import subprocess
import sys

import numpy as np
import pytest

from spikelane.main import run
from spikelane_controllers import registry
from spikelane_controllers.braitenberg.controller import Braitenberg
from spikelane_controllers.learning.training import Training
from spikelane_controllers.registry import (
    controller_class,
    controller_names,
    controller_packages,
    make_controller,
    training_class,
    training_names,
)
from spikelane_sim.contract import Observation
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import no_events
from spikelane_sim.parameters import Parameters
from spikelane_sim.period import PERIOD_NS


@pytest.fixture
def install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[str, str, str], None]]:
    """Give what installs a package with one entry point of a group."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def write(package: str, group: str, point: str) -> None:
        folder = tmp_path / f'{package}-1.0.dist-info'
        folder.mkdir()
        (folder / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {package}\n')
        (folder / 'entry_points.txt').write_text(f'[{group}]\n{point}\n')
        forget()

    def forget() -> None:
        registry._entries.cache_clear()

    yield write
    forget()


@pytest.mark.parametrize('name', ['braitenberg', 'dqn', 'dqn_snn', 'rstdp'])
def test_every_controller_can_be_made_and_driven(name: str) -> None:
    """At its defaults, by the contract."""
    controller = make_controller(name)
    controller.reset(np.random.default_rng(0))
    wheels = controller.step(Observation(PERIOD_NS, no_events(), None))
    assert np.isfinite(wheels).all()
    assert issubclass(controller_class(name).parameters_class, Parameters)


def test_parameters_reach_the_controller() -> None:
    """Dotted or nested."""
    for values in ({'steering.n_max': 20}, {'steering': {'n_max': 20}}):
        controller = make_controller('braitenberg', values)
        assert isinstance(controller, Braitenberg)
        assert controller.parameters.steering.n_max == 20


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    """One sentence."""
    with pytest.raises(ParameterError, match=r"expected one of braitenberg.*, got 'x'"):
        make_controller('x')


def test_the_registry_loads_no_controller_before_it_is_asked_for() -> None:
    """Nor torch with the Braitenberg controller."""
    code = (
        'import sys, spikelane_controllers.registry as r;'
        'print("spikelane_controllers.braitenberg.controller" in sys.modules);'
        'r.make_controller("braitenberg"); print("torch" in sys.modules)'
    )
    path = {'PYTHONPATH': ':'.join(sys.path)}
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True, env=path
    )
    assert done.stdout.split() == ['False', 'False']


def test_other_packages_add_controllers_and_their_trainings(
    install: Callable[[str, str, str], None],
) -> None:
    """After those of this one, with the package that has the node."""
    install(
        'a-b',
        'spikelane.controllers',
        'abc = spikelane_controllers.braitenberg.controller:Braitenberg',
    )
    install('c', 'spikelane.trainings', 'abc = spikelane_controllers.learning.training:Training')
    assert controller_names() == ('braitenberg', 'dqn', 'dqn_snn', 'rstdp', 'abc')
    assert training_names() == ('dqn', 'rstdp', 'abc')
    assert controller_packages()['abc'] == 'a_b'
    assert isinstance(make_controller('abc', {'steering.n_max': 20}), Braitenberg)
    assert training_class('abc') is Training


@pytest.mark.parametrize('name', ['Abc', 'a.b', 'dqn'])
def test_a_controller_cannot_have_every_name(
    name: str, install: Callable[[str, str, str], None]
) -> None:
    """One that a node cannot have, or that is taken."""
    install('p', 'spikelane.controllers', f'{name} = os:path')
    with pytest.raises(ParameterError, match=f"got '{name}' of package p$"):
        controller_names()


@pytest.mark.parametrize(
    ('place', 'cause'),
    [
        ('no_such_module:X', 'ModuleNotFoundError'),
        ('os:NoSuch', 'AttributeError'),
        ('?', 'AttributeError'),
        ('raises:X', "RuntimeError('no licence found')"),
        ('exits:X', 'SystemExit(0)'),
        ('wrong:X', 'SyntaxError'),
    ],
)
def test_a_controller_that_cannot_be_imported_is_told_in_one_sentence(
    place: str, cause: str, tmp_path: Path, install: Callable[[str, str, str], None]
) -> None:
    """With its entry point, the package that promised it, and what its module raised."""
    (tmp_path / 'raises.py').write_text("raise RuntimeError('no licence\\nfound')\n")
    (tmp_path / 'exits.py').write_text('import sys\nsys.exit(0)\n')
    (tmp_path / 'wrong.py').write_text('class X(:\n')
    for group, load in (
        ('spikelane.controllers', make_controller),
        ('spikelane.trainings', training_class),
    ):
        install(f'p.{group}', group, f'abc = {place}')
        with pytest.raises(ParameterError) as caught:
            load('abc')
        text = str(caught.value)
        expected = f'controller abc: expected {place}, which package p.{group} registers'
        assert text.startswith(f'{expected}, got ')
        assert cause in text.replace('\\n', ' ')


def test_what_is_no_controller_is_refused(install: Callable[[str, str, str], None]) -> None:
    """Before anything is asked of it."""
    install('p', 'spikelane.controllers', 'abc = os:path')
    with pytest.raises(ParameterError, match='controller abc: expected a class with param'):
        controller_class('abc')


def test_a_controller_that_cannot_be_imported_is_in_the_way_of_no_other(
    tmp_path: Path,
    install: Callable[[str, str, str], None],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It is named among all, and only a command that is to use it ends, with one line."""
    (tmp_path / 'raises.py').write_text("raise RuntimeError('no licence found')\n")
    install('p', 'spikelane.controllers', 'abc = raises:X')
    short = ['--transport', 'inprocess', '--robot', 'kinematic']
    short += ['--param', 'simulator.episode.max_steps=5']
    for name, status in (('braitenberg', 1), ('abc', 2)):  # the lap is not completed
        out = str(tmp_path / name)
        assert run(['lap', '--controller', name, *short, '--out', out]) == status
        assert (tmp_path / name / 'metrics.json').exists() == (name == 'braitenberg')
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith('spikelane lap: controller abc: expected raises:X, which package p ')
    assert "RuntimeError('no licence found')" in line
