"""Sensor presets: the pixels of real event cameras, as parameters of the simulator.

A preset is a YAML file. Of each value it says where it comes from:

- `read`: the source was looked up for this preset;
- `measured`: in the recording that is named;
- `quoted`: from the source that is named, which was not looked up again;
- `assumed`: by us, for the reason given.

The image keeps the size that controllers are made for; that of the camera itself, in the preset,
is for people.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypedDict

from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.kinds import check_kind, Scalar
from spikelane_sim.parsing import read_yaml_file
from spikelane_sim.simulator_parameters import SimulatorParameters

_FOLDER = Path(__file__).parent / 'sensor_presets'

#: How sure a value is.
BASES = ('read', 'measured', 'quoted', 'assumed')


class PresetValue(TypedDict):
    """One value of a preset."""

    value: Scalar
    basis: str  # one of BASES
    source: str  # a place, or why it is assumed


class SensorPreset(TypedDict):
    """A preset, as its file has it."""

    title: str
    width: int  # columns of the camera [px]
    height: int  # rows of the camera [px]
    values: dict[str, PresetValue]  # by the names of the simulator's parameters
    remarks: list[str]  # what the simulator does not do


def preset_names() -> tuple[str, ...]:
    """Return the names of the shipped presets."""
    return tuple(sorted(path.stem for path in _FOLDER.glob('*.yaml')))


def load_preset(name_or_path: str) -> SensorPreset:
    """Return a preset.

    Args:
        name_or_path: A name of `preset_names`, or the path of a file.

    Raises:
        ParameterError: There is none, or it is not one; the message names the file.
    """
    path = Path(name_or_path)
    if name_or_path in preset_names():
        path = _FOLDER / f'{name_or_path}.yaml'
    elif not path.suffix:
        raise ParameterError(
            f'preset: expected one of {", ".join(preset_names())}, or the path of a .yaml file, '
            f'got {name_or_path!r:.200}'
        )
    try:
        preset: SensorPreset = check_kind(read_yaml_file(path), SensorPreset)
        for name, each in preset['values'].items():
            if each['basis'] not in BASES:
                raise ParameterError(
                    f'values.{name}.basis: expected one of {", ".join(BASES)}, '
                    f'got {each["basis"]!r:.80}'
                )
        SimulatorParameters.from_mapping(preset_parameters(preset))
    except SpikelaneError as error:
        raise ParameterError(f'{path}: {error}') from None
    return preset


def preset_parameters(preset: SensorPreset) -> dict[str, Any]:
    """Return a preset's parameters of the simulator, by their names."""
    return {name: each['value'] for name, each in preset['values'].items()}
