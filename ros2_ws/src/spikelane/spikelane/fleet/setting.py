"""What runs must have in common to be robots of one fleet, and whether a kernel has it."""

from __future__ import annotations

from collections.abc import Sequence
import json
from typing import Any

from spikelane.fleet.fleet import Fleet
from spikelane.runs.configuration import Configuration
from spikelane_controllers.registry import card, fleet_class
from spikelane_sim.errors import ParameterError
from spikelane_sim.filters.compiled import check_chain
from spikelane_sim.fleet.world import ENGINES

#: What robots of one fleet may each have of their own.
_OWN = ('seed', 'scenario', 'course', 'lane', 'training', 'evaluation', 'given')

#: Steps of all robots together from which the kernel is used for what single simulators do to the
#: same bytes. It takes less than half of the 40 to 60 µs that a step takes alone, but 25 to 50 s
#: to be compiled where it was not used yet: with fewer steps nobody should wait for that.
LEAST_STEPS = 500_000

#: Robots of a fleet: more would be no faster, and more would be lost where its process is killed.
_MOST_ROBOTS = 64

#: The same where each has a physics engine of its own, which takes about 36 MB with pybullet.
_MOST_WITH_ENGINES = 8


def use_kernel_always() -> None:
    """From now on use the kernel in this process where there is one, however few the steps are."""
    global LEAST_STEPS
    LEAST_STEPS = 0


def has_kernel(config: Configuration) -> bool:
    """Return whether the kernel has all that determines how a run drives."""
    if config.transport != 'inprocess':
        return False
    if not card(config.controller).fleet:
        return False
    try:
        check_chain(config.filter)
        fleet_class(config.controller).check(config.controller_parameters)
    except ParameterError:
        return False
    return True


def most_together(config: Configuration) -> int:
    """Return how many runs of one setting are done in one fleet."""
    is_compiled = config.simulator.robot.engine in ENGINES
    return _MOST_ROBOTS if is_compiled else _MOST_WITH_ENGINES


def setting_key(config: Configuration) -> str:
    """Return what runs of one fleet have in common as a text, '' where there is no kernel."""
    return json.dumps(setting(config), sort_keys=True) if has_kernel(config) else ''


def setting(config: Configuration) -> dict[str, Any]:
    """Return all that the robots of a fleet must have in common."""
    values = {name: value for name, value in config.to_dict().items() if name not in _OWN}
    weights = {'checkpoint': ''} if 'checkpoint' in values[config.controller] else {}
    return {
        **values,
        'simulator': {**values['simulator'], 'course': ''},
        config.controller: {**values[config.controller], **weights},
    }


def fleet_of(configs: Sequence[Configuration], threads: int) -> Fleet:
    """Make the fleet that does runs, with the parameters of the first one.

    Args:
        configs: What determines each run, at least one.
        threads: How many threads drive the robots.

    Raises:
        SpikelaneError: They are not runs of one setting, or the kernel lacks what they need.
    """
    first = configs[0]
    if any(setting(config) != setting(first) for config in configs[1:]):
        raise ParameterError(
            'fleet: expected runs that differ in seed, lane, course, length and weights alone'
        )
    return Fleet(
        first.controller,
        [config.seed for config in configs],
        simulator=first.simulator,
        parameters=first.controller_parameters.to_dict(),
        courses=[config.simulator.course for config in configs],
        filters=first.filter,
        threads=threads,
    )
