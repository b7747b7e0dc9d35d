"""Controllers by name."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from spikelane_controllers.braitenberg import Braitenberg
from spikelane_controllers.registry import controller_class, CONTROLLERS, make_controller
from spikelane_sim.contract import Observation, STEP_NS
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import no_events
from spikelane_sim.parameters import Parameters


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
