"""Sweeps of an experiment file: a parameter with several values, each parameter an axis.

sweep:
  rstdp.c_r: [0.003, 0.01, 0.03]
  rstdp.poisson.max_rate_hz: {from: 100, to: 400, count: 4}
  simulator.pixels.coppelia.noise_rate_hz: {from: 0.01, to: 1, count: 5, scale: log}
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import ParameterSpec
from spikelane_sim.yaml_file import YamlValue

#: What the names of these axes begin with; the parameter's name follows.
PREFIX = 'sweep.'

_MOST = 1000  # values of a range
_DIGITS = 6  # of the values of a range


def read_sweep(
    value: YamlValue,
    specs: Mapping[str, ParameterSpec],
    check_name: Callable[[str, YamlValue], str],
) -> dict[str, dict[str, dict[str, Any]]]:
    """Read the values of swept parameters.

    Args:
        value: The mapping `sweep`.
        specs: The parameters that may be swept, by their full names.
        check_name: Given the name of a value and where it is, refuses one that cannot be part of a
            folder's name.

    Returns:
        An axis for each parameter, `sweep.` and its full name: the names of its values, and the
        parameters that these stand for.
    """
    axes = {}
    for name, each in value.entries():
        if name not in specs:
            each.refuse(f'unknown parameter {name!r}, expected one of {_near(name, specs)}')
        values = _range(each, specs[name]) if each.is_mapping else _list(each, specs[name])
        short = name.rpartition('.')[2]
        axes[PREFIX + name] = {
            check_name(f'{short}-{_text(found)}', each): {name: found} for found in values
        }
    return axes or value.fail('at least one parameter')


def _list(value: YamlValue, spec: ParameterSpec) -> Sequence[Any]:
    items = value.items()
    return [each.parameter(spec) for each in items] or value.fail('a list of at least one')


def _range(value: YamlValue, spec: ParameterSpec) -> Sequence[Any]:
    """Return the values of a range, both ends included."""
    if spec.kind not in (int, float):
        value.fail(f'a list of values, since {spec.name} is no number')
    fields = value.fields('from to count', 'scale')
    first, last = (fields[end].parameter(spec) for end in ('from', 'to'))
    count = fields['count'].whole_number(2, _MOST)
    is_log = 'scale' in fields and fields['scale'].choice('linear', 'log') == 'log'
    if is_log and not (first > 0 and last > 0):
        value.refuse(f'{spec.name}: expected a range above 0 with scale log, got from {first:g}')
    spread = np.geomspace if is_log else np.linspace
    numbers = [float(f'{each:.{_DIGITS}g}') for each in spread(first, last, count)]
    if spec.kind is int:
        numbers = list(dict.fromkeys(round(each) for each in numbers))
    try:
        return [spec.check(each) for each in numbers]
    except ParameterError as error:
        value.refuse(error)


def _text(value: Any) -> str:
    """Return a value as part of a name."""
    return f'{value:g}' if isinstance(value, float) else str(value).lower()


def _near(name: str, specs: Mapping[str, ParameterSpec]) -> str:
    """Return the names of the parameters of the same group, or the groups."""
    group = name.partition('.')[0]
    found = [each for each in specs if each.partition('.')[0] == group]
    return ', '.join(found or sorted({f'{each.partition(".")[0]}.<name>' for each in specs}))


def swept_value(axis: str, name: str) -> float | str:
    """Return the value that a name on the axis of a swept parameter stands for.

    Args:
        axis: `sweep.` and the parameter's full name.
        name: As `read_sweep` made it.

    Returns:
        The number, or the text where the value is not a number.
    """
    text = name.removeprefix(f'{axis.rpartition(".")[2]}-')
    try:
        return float(text)
    except ValueError:
        return text


def swept_parameters(results: Mapping[str, Any]) -> list[str]:
    """Return the full names of the parameters that an experiment sweeps."""
    axes = (name for group in results.get('groups', ()) for name in group)
    return [name.removeprefix(PREFIX) for name in dict.fromkeys(axes) if name.startswith(PREFIX)]
