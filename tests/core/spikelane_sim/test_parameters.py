"""Parameters: what is taken, what is refused and how it is said."""

from __future__ import annotations

from dataclasses import dataclass, FrozenInstanceError
import json
import math
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import yaml

from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import flatten, grouped, nested, parameter, Parameters


@dataclass(frozen=True, kw_only=True)
class Lens(Parameters):
    """A group in a group."""

    fov_deg: float = parameter(90.0, 'Opening.', unit='deg', low=1.0, high=170.0)
    weights: tuple[float, ...] = parameter((1.0, 2.0), 'Of the rings.', low=0.0)


@dataclass(frozen=True, kw_only=True)
class Eye(Parameters):
    """A group."""

    width: int = parameter(128, 'Columns.', unit='px', low=1, source='section 3.1')
    shift: int = parameter(0, 'Rows to leave out.', high=10)
    lens: Lens = nested(Lens)

    def _check_relations(self) -> None:
        if self.shift >= self.width:
            raise ParameterError(f'shift: expected less than the width, got {self.shift}')


@dataclass(frozen=True, kw_only=True)
class Creature(Parameters):
    """All kinds of parameters."""

    name: str = parameter('fly', 'Its name.')
    mood: str = parameter('calm', 'How it feels.', choices=('calm', 'wild'))
    flies: bool = parameter(True, 'Whether it flies.')
    offset_m: float = parameter(0.0, 'Anywhere.', unit='m')
    eye: Eye = nested(Eye)


finite = st.floats(allow_nan=False, allow_infinity=False)
creatures = st.fixed_dictionaries(
    {},
    optional={
        'name': st.text(),
        'mood': st.sampled_from(('calm', 'wild')),
        'flies': st.booleans(),
        'offset_m': finite,
        'eye.width': st.integers(11, 10**12),
        'eye.shift': st.integers(-(10**12), 10),
        'eye.lens.fov_deg': st.floats(1.0, 170.0),
        'eye.lens.weights': st.lists(st.floats(0.0, 1e300)),
    },
)


@given(creatures)
def test_what_is_written_reads_back_equal(values: dict[str, Any]) -> None:
    """As a mapping, as YAML and as JSON; all values given are there."""
    creature = Creature.from_mapping(values)
    written = creature.to_dict()
    assert values.items() <= written.items()
    assert Creature.from_mapping(written) == creature
    assert Creature.from_mapping(yaml.safe_load(yaml.safe_dump(written))) == creature
    assert Creature.from_mapping(json.loads(json.dumps(written))) == creature


def test_all_defaults_stand_under_dotted_names() -> None:
    """In the order of declaration, groups last; lists are lists."""
    assert list(Creature().to_dict().items()) == [
        ('name', 'fly'),
        ('mood', 'calm'),
        ('flies', True),
        ('offset_m', 0.0),
        ('eye.width', 128),
        ('eye.shift', 0),
        ('eye.lens.fov_deg', 90.0),
        ('eye.lens.weights', [1.0, 2.0]),
    ]


def test_nested_mappings_and_dotted_names_mean_the_same() -> None:
    """Also in a mixture."""
    dotted = Creature.from_mapping({'eye.width': 16, 'eye.lens.fov_deg': 50})
    assert dotted == Creature.from_mapping({'eye': {'width': 16, 'lens': {'fov_deg': 50}}})
    assert dotted == Creature.from_mapping({'eye': {'width': 16, 'lens.fov_deg': 50}})
    assert (dotted.eye.width, dotted.eye.lens.fov_deg, dotted.eye.shift) == (16, 50.0, 0)


def test_a_specification_tells_all_that_was_declared() -> None:
    """Nested ones under their dotted names."""
    width = {spec.name: spec for spec in Creature.specs()}['eye.width']
    assert (width.kind, width.default, width.description) == (int, 128, 'Columns.')
    assert (width.unit, width.low, width.high, width.choices) == ('px', 1, None, ())
    assert width.source == 'section 3.1'


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        ('name', 3, 'name: expected a text, got 3'),
        ('name', None, 'name: expected a text, got None'),
        ('mood', 'sad', "mood: expected one of calm, wild, got 'sad'"),
        ('mood', 1, 'mood: expected one of calm, wild, got 1'),
        ('flies', 1, 'flies: expected true or false, got 1'),
        ('flies', 'true', "flies: expected true or false, got 'true'"),
        ('offset_m', math.nan, 'offset_m: expected a number [m], got nan'),
        ('offset_m', math.inf, 'offset_m: expected a number [m], got inf'),
        ('offset_m', True, 'offset_m: expected a number [m], got True'),
        ('offset_m', '1.0', "offset_m: expected a number [m], got '1.0'"),
        ('offset_m', [1.0], 'offset_m: expected a number [m], got [1.0]'),
        ('eye.width', 0, 'eye.width: expected a whole number of at least 1 px, got 0'),
        ('eye.width', 1.0, 'eye.width: expected a whole number of at least 1 px, got 1.0'),
        ('eye.width', True, 'eye.width: expected a whole number of at least 1 px, got True'),
        ('eye.shift', 11, 'eye.shift: expected a whole number of at most 10, got 11'),
        (
            'eye.lens.fov_deg',
            170.1,
            'eye.lens.fov_deg: expected a number from 1 to 170 deg, got 170.1',
        ),
        (
            'eye.lens.fov_deg',
            0.9,
            'eye.lens.fov_deg: expected a number from 1 to 170 deg, got 0.9',
        ),
        (
            'eye.lens.weights',
            1.0,
            'eye.lens.weights: expected a list of numbers of at least 0, got 1.0',
        ),
    ],
)
def test_a_wrong_value_is_refused_with_what_is_allowed(
    name: str, value: object, message: str
) -> None:
    """One sentence: the parameter, what was expected, what came."""
    with pytest.raises(ParameterError) as error:
        Creature.from_mapping({name: value})
    assert str(error.value) == message


@pytest.mark.parametrize(
    'value', ['12', ['1'], [True], [math.nan], [1.0, -0.5], [1.0, None], {'a': 1.0}, None]
)
def test_a_list_takes_numbers_in_range_only(value: object) -> None:
    """Every item is checked."""
    with pytest.raises(ParameterError, match='weights'):
        Creature.from_mapping({'eye.lens.weights': value})


@pytest.mark.parametrize('value', [[1, 2.5], (1.0, 2.5), np.array([1.0, 2.5])])
def test_a_list_becomes_a_tuple_of_floats(value: object) -> None:
    """Whatever sequence it came as."""
    weights = Creature.from_mapping({'eye.lens.weights': value}).eye.lens.weights
    assert weights == (1.0, 2.5)
    assert [type(weight) for weight in weights] == [float, float]


def test_an_empty_list_is_a_list() -> None:
    """Nothing in it is out of range."""
    assert Lens(weights=()).weights == ()


def test_a_whole_number_is_a_number() -> None:
    """It becomes a float, since YAML and people write 50 for 50.0."""
    offset_m = Creature(offset_m=3).offset_m
    assert (offset_m, type(offset_m)) == (3.0, float)


def test_numpy_scalars_become_plain_values() -> None:
    """So that YAML and JSON can write them."""
    creature = Creature.from_mapping(
        {'offset_m': np.float64(0.5), 'flies': np.bool_(False), 'eye.width': np.int64(7)}
    )
    values = (creature.offset_m, creature.flies, creature.eye.width)
    assert [type(value) for value in values] == [float, bool, int]
    assert values == (0.5, False, 7)


@pytest.mark.parametrize('value', [10**400, np.array([1.0, 2.0]), np.array([1.0])])
def test_what_no_float_can_hold_is_refused(value: object) -> None:
    """With the same error as all else."""
    with pytest.raises(ParameterError, match=r'offset_m: expected a number \[m\], got'):
        Creature.from_mapping({'offset_m': value})


def test_limits_belong_to_the_range() -> None:
    """Both ends are allowed."""
    assert [Lens(fov_deg=fov).fov_deg for fov in (1.0, 170.0)] == [1.0, 170.0]


@pytest.mark.parametrize(
    'values', [{'eye.length': 1}, {'eye': {'length': 1}}, {'eye': {'length': {}}, 'eye.length': 1}]
)
def test_an_unknown_name_is_refused_with_the_known_ones(values: dict[str, Any]) -> None:
    """A slip of the pen never passes silently."""
    with pytest.raises(ParameterError) as error:
        Creature.from_mapping(values)
    assert str(error.value) == (
        "unknown parameter 'eye.length'; expected name, mood, flies, offset_m, eye.width, "
        'eye.shift, eye.lens.fov_deg, eye.lens.weights'
    )


def test_a_value_for_a_whole_group_is_refused() -> None:
    """A group is a mapping."""
    with pytest.raises(ParameterError, match="unknown parameter 'eye'"):
        Creature.from_mapping({'eye': 3})


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'colour': 1}, "fly.yaml: unknown parameter 'colour'"),
        ({'flies': 1}, 'fly.yaml: flies: expected true or false'),
        ({'eye.width': 5, 'eye.shift': 5}, 'fly.yaml: shift: expected less than the width'),
    ],
)
def test_an_error_names_the_place_the_values_came_from(
    values: dict[str, Any], message: str
) -> None:
    """A file's path, say."""
    with pytest.raises(ParameterError) as error:
        Creature.from_mapping(values, 'fly.yaml')
    assert str(error.value).startswith(message)


def test_construction_checks_as_well() -> None:
    """Not only what comes from files."""
    with pytest.raises(ParameterError, match='width: expected a whole number'):
        Eye(width=0)


def test_fields_that_contradict_each_other_are_refused() -> None:
    """Each alone would be allowed."""
    with pytest.raises(ParameterError, match='shift: expected less than the width, got 5'):
        Eye(width=5, shift=5)


def test_parameters_do_not_change() -> None:
    """What determined a run stays what it was."""
    creature = Creature()
    with pytest.raises(FrozenInstanceError):
        creature.name = 'bee'  # type: ignore[misc]


def test_nested_values_get_dotted_names() -> None:
    """However deep they are; lists and what is empty inside are values and nothing."""
    values = {'seed': 1, 'camera': {'width': 128, 'lens': {'fov_deg': 60.0}}, 'a': [1], 'b': {}}
    assert flatten(values) == {
        'seed': 1,
        'camera.width': 128,
        'camera.lens.fov_deg': 60.0,
        'a': [1],
    }


def test_names_are_sorted_by_group() -> None:
    """The first part of a name is its group; the others are kept together."""
    values = {'simulator.camera.width': 64, 'rstdp.c_r': 0.1, 'simulator.course': 'x', 'seed': 3}
    assert grouped(values) == {
        'simulator': {'camera.width': 64, 'course': 'x'},
        'rstdp': {'c_r': 0.1},
        'seed': {'': 3},
    }
