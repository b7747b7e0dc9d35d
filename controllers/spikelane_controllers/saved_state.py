"""A controller's state as a flat mapping of names to arrays and numbers, for checkpoints.

Records (NamedTuples of arrays and numbers) are spread under dotted names. An array of a structured
type becomes an array per field, so that everything can be stored as safetensors and JSON.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, cast, get_args, get_type_hints, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import CheckpointError

SavedState = dict[str, Any]  # of arrays without fields, bool, int, float

RecordT = TypeVar('RecordT', bound=NamedTuple)

_KIND_NAMES = {bool: 'true or false', int: 'a whole number', float: 'a number'}
_WORD = 1 << 64
_LARGEST = 1 << 63  # of whole numbers


def spread(prefix: str, record: NamedTuple) -> SavedState:
    """Return the arrays and numbers of a record as `prefix.field`, or `prefix.field.subfield`."""
    state: SavedState = {}
    for name, value in record._asdict().items():
        if isinstance(value, np.ndarray):
            for key, part in _columns(f'{prefix}.{name}', value).items():
                state[key] = np.array(part)
        else:
            state[f'{prefix}.{name}'] = value
    return state


def gather(prefix: str, like: RecordT, state: Mapping[str, Any]) -> RecordT:
    """Return the record that was spread.

    Args:
        prefix: As given to `spread`.
        like: A record of the same kind. Shapes must be as in it, but arrays of structured types
            may have any length.
        state: What `spread` returned.

    Raises:
        CheckpointError: Something is missing, of another shape or kind, or not finite.
    """
    values = {}
    for name, example in like._asdict().items():
        key = f'{prefix}.{name}'
        if not isinstance(example, np.ndarray):
            values[name] = number(state, key, type(example))
        elif example.dtype.names is None:
            values[name] = array(state, key, example.dtype, example.shape)
        else:
            values[name] = _structured(state, key, example.dtype)
    return like._replace(**values)


def number(state: Mapping[str, Any], name: str, kind: type) -> Any:
    """Return a number of the state.

    Raises:
        CheckpointError: It is missing, of another kind or not finite.
    """
    value = _look_up(state, name)
    if not isinstance(value, kind) or not _is_of(value, (kind,)):
        raise CheckpointError(f'{name}: expected {_KIND_NAMES[kind]}, got {value!r:.80}')
    return value


def mapping(facts: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return a mapping of the facts, empty where it is missing.

    Raises:
        CheckpointError: It is something else.
    """
    value = facts.get(name, {})
    if not isinstance(value, dict):
        raise CheckpointError(f'{name}: expected a mapping, got {value!r:.80}')
    return value


def records(facts: Mapping[str, Any], name: str, cls: type[RecordT]) -> list[RecordT]:
    """Return records that the facts hold as lists of numbers and texts.

    Args:
        facts: The facts.
        name: Name of the list of records.
        cls: A NamedTuple, whose annotations say what its fields are.

    Raises:
        CheckpointError: The list is missing, or an entry is no such record.
    """
    kinds = [get_args(hint) or (hint,) for hint in get_type_hints(cls).values()]
    values = _look_up(facts, name)
    if not isinstance(values, list):
        raise CheckpointError(f'{name}: expected a list, got {values!r:.80}')
    for index, each in enumerate(values):
        is_record = isinstance(each, list) and len(each) == len(kinds)
        if not is_record or not all(map(_is_of, each, kinds)):
            expected = ', '.join(cls._fields)
            raise CheckpointError(f'{name}[{index}]: expected {expected}, got {each!r:.80}')
    return [cls(*each) for each in values]


def _is_of(value: Any, kinds: tuple[type, ...]) -> bool:
    """Return whether a value is of one of these kinds; a whole number is a float, too."""
    if isinstance(value, bool):
        return bool in kinds
    if isinstance(value, int):
        return (int in kinds or float in kinds) and abs(value) < _LARGEST
    if isinstance(value, float):
        return float in kinds and math.isfinite(value)
    return isinstance(value, kinds)


def array(
    state: Mapping[str, Any],
    name: str,
    dtype: np.dtype[Any],
    shape: tuple[int | None, ...] = (None,),
) -> NDArray[Any]:
    """Return a copy of an array of the state.

    Args:
        state: The state.
        name: Name of the array.
        dtype: Its type.
        shape: Lengths of its axes, None for any length.

    Raises:
        CheckpointError: It is missing, of another shape or type, or not finite.
    """
    value = _look_up(state, name)
    if not isinstance(value, np.ndarray) or value.dtype != dtype:
        raise CheckpointError(
            f'{name}: expected an array of {dtype}, got {getattr(value, "dtype", value)!s:.80}'
        )
    is_shape = value.ndim == len(shape) and all(
        wanted in (None, given) for wanted, given in zip(shape, value.shape, strict=True)
    )
    if not is_shape:
        expected = 'one axis' if shape == (None,) else f'shape {shape}'
        raise CheckpointError(f'{name}: expected {expected}, got shape {value.shape}')
    if not np.isfinite(value).all():
        raise CheckpointError(f'{name}: expected finite numbers, got {_first_other(value)}')
    return value.copy()


def spread_generator(prefix: str, rng: np.random.Generator) -> SavedState:
    """Return the state of a generator made by `numpy.random.default_rng`."""
    state = cast(dict[str, Any], rng.bit_generator.state)
    words = [
        word for key in ('state', 'inc') for word in divmod(cast(int, state['state'][key]), _WORD)
    ]
    return {
        f'{prefix}.words': np.array(words, np.uint64),
        f'{prefix}.has_uint32': int(state['has_uint32']),
        f'{prefix}.uinteger': int(state['uinteger']),
    }


def gather_generator(prefix: str, state: Mapping[str, Any]) -> np.random.Generator:
    """Return the generator that was spread; it goes on with the same numbers.

    Raises:
        CheckpointError: Something is missing, or of another shape or kind.
    """
    words = array(state, f'{prefix}.words', np.dtype(np.uint64), (4,)).tolist()
    bits = np.random.PCG64()
    bits.state = {
        'bit_generator': 'PCG64',
        'state': {'state': words[0] * _WORD + words[1], 'inc': words[2] * _WORD + words[3]},
        'has_uint32': _word(state, f'{prefix}.has_uint32', 1),
        'uinteger': _word(state, f'{prefix}.uinteger', 2**32 - 1),
    }
    return np.random.Generator(bits)


def _word(state: Mapping[str, Any], name: str, largest: int) -> int:
    value: int = number(state, name, int)
    if not 0 <= value <= largest:
        raise CheckpointError(f'{name}: expected a whole number from 0 to {largest}, got {value}')
    return value


def check_names(state: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
    """Check that a state has the names of another one and no more.

    Raises:
        CheckpointError: A name is missing or unknown.
    """
    for name in expected:
        _look_up(state, name)
    for name in state:
        if name not in expected:
            raise CheckpointError(f'{name}: expected one of {", ".join(expected)}')


def _columns(name: str, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
    if values.dtype.names is None:
        return {name: values}
    return {f'{name}.{field}': values[field] for field in values.dtype.names}


def _structured(state: Mapping[str, Any], name: str, dtype: np.dtype[Any]) -> NDArray[Any]:
    columns = {field: array(state, f'{name}.{field}', dtype[field]) for field in dtype.names or ()}
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1:
        raise CheckpointError(f'{name}: expected fields of one length, got {sorted(lengths)}')
    values = np.empty(lengths.pop(), dtype)
    for field, column in columns.items():
        values[field] = column
    return values


def _look_up(state: Mapping[str, Any], name: str) -> Any:
    if name not in state:
        raise CheckpointError(f'{name}: expected in the state, but it is missing')
    return state[name]


def _first_other(values: NDArray[Any]) -> float:
    return float(values[~np.isfinite(values)][0])
