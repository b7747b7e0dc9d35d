"""Controllers by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
import subprocess
import sys

import numpy as np
import pytest

from spikelane_controllers import registry
from spikelane_controllers.braitenberg import Braitenberg
from spikelane_controllers.registry import (
    controller_class,
    controller_names,
    controller_packages,
    CONTROLLERS,
    make_controller,
    training_class,
    training_names,
)
from spikelane_controllers.training import Training
from spikelane_sim.contract import Observation, STEP_NS
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import no_events
from spikelane_sim.parameters import Parameters


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
        registry._entries.cache_clear()

    yield write
    registry._entries.cache_clear()


@pytest.mark.parametrize('name', CONTROLLERS)
def test_every_controller_can_be_made_and_driven(name: str) -> None:
    """At its defaults, by the contract."""
    controller = make_controller(name)
    controller.reset(np.random.default_rng(0))
    wheels = controller.step(Observation(STEP_NS, no_events(), None))
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
        'print("spikelane_controllers.braitenberg" in sys.modules);'
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
    install('a-b', 'spikelane.controllers', 'abc = spikelane_controllers.braitenberg:Braitenberg')
    install('c', 'spikelane.trainings', 'abc = spikelane_controllers.training:Training')
    assert controller_names() == ('braitenberg', 'rstdp', 'dqn', 'dqn_snn', 'abc')
    assert training_names() == ('rstdp', 'dqn', 'abc')
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


@pytest.mark.parametrize('place', ['no_such_module:X', 'os:NoSuch'])
def test_a_controller_that_is_not_there_is_told_in_one_sentence(
    place: str, install: Callable[[str, str, str], None]
) -> None:
    """With the package that promised it."""
    install('p', 'spikelane.controllers', f'abc = {place}')
    with pytest.raises(ParameterError, match=f'controller abc: expected {place} as package p'):
        make_controller('abc')
