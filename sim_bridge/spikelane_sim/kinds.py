"""Values of JSON and YAML that others wrote, checked against Python's annotations.

What a file must hold is declared as a TypedDict, a NamedTuple or an annotation made of the plain
kinds, and checked in one place before anything is computed with it.
"""

from __future__ import annotations

from collections.abc import Mapping
import functools
import types
from typing import Any, get_args, get_origin, get_type_hints, is_typeddict, Union

from spikelane_sim.errors import SpikelaneError

#: A value of a configuration: a number, a text, or nothing.
Scalar = bool | int | float | str | None

_WORDS = {
    bool: 'true or false',
    int: 'a whole number',
    float: 'a number',
    str: 'a text',
    type(None): 'nothing',
}
_LARGEST = 2**63  # of whole numbers
#: The largest number that is accepted: no quantity comes near it, and its square is finite.
_BEYOND = 1e100


class KindError(SpikelaneError):
    """A value in a file is missing or of another kind than it must be."""

    exit_status = 1


def check_kind(value: Any, kind: Any, name: str = '') -> Any:
    """Check a value of a file.

    Args:
        value: As a parser has made it: of dicts, lists, texts, numbers and None.
        kind: What it must be: bool, int (of 64 bits), float (below 1e100, or such a whole number),
            str, None, Any, `list[kind]`, `dict[str, kind]`, a union of these, a TypedDict (a
            mapping with its fields, perhaps with others), or a NamedTuple (a mapping with its
            fields and no others; those with a default may be missing).
        name: Name of the value, for the message; '' for all that a file holds.

    Returns:
        The value as it is.

    Raises:
        KindError: It is of another kind; the message names the innermost value that is.
    """
    # A union has one kind of list or mapping at most.
    fitting = [
        each for each in _kinds(kind) if _is_plain(value, each) or _is_container(value, each)
    ]
    if not fitting:
        raise _refused(value, kind, name)
    kind = fitting[0]
    if _is_plain(value, kind):
        return value
    if get_origin(kind) is list:
        for index, each in enumerate(value):
            check_kind(each, get_args(kind)[0], f'{name}[{index}]')
    else:
        _check_mapping(value, kind, name)
    return value


def _kinds(kind: Any) -> tuple[Any, ...]:
    """Return the kinds that a union is of, or the kind alone."""
    return get_args(kind) if get_origin(kind) in (Union, types.UnionType) else (kind,)


def _is_plain(value: Any, kind: Any) -> bool:
    """Return whether a value is of a kind that has no parts."""
    if kind is Any:
        return True
    if kind is None or kind is type(None):
        return value is None
    if isinstance(value, bool):
        return kind is bool
    if isinstance(value, int):
        return kind in (int, float) and abs(value) < _LARGEST
    if isinstance(value, float):
        return kind is float and abs(value) < _BEYOND  # NaN neither
    return kind is str and isinstance(value, str)


def _is_mapping(kind: Any) -> bool:
    return get_origin(kind) in (dict, Mapping) or is_typeddict(kind) or hasattr(kind, '_fields')


def _is_container(value: Any, kind: Any) -> bool:
    """Return whether a value is of a kind that has parts, whatever its parts are."""
    if isinstance(value, Mapping):
        return _is_mapping(kind)
    return isinstance(value, list) and get_origin(kind) is list


def _check_mapping(value: Mapping[Any, Any], kind: Any, name: str) -> None:
    inner = f'{name}.' if name else ''
    for key in value:
        if not isinstance(key, str):
            raise KindError(f'{inner}{key!r:.80}: expected names for keys, got {key!r:.80}')
    if get_origin(kind) in (dict, Mapping):
        for key, each in value.items():
            check_kind(each, get_args(kind)[1], f'{inner}{key}')
        return
    fields = _fields(kind)
    if not is_typeddict(kind):
        for key in value:
            if key not in fields:
                raise KindError(f'{inner}{key}: expected one of {", ".join(fields)}')
    for key, hint in fields.items():
        if key in value:
            check_kind(value[key], hint, f'{inner}{key}')
        elif key in _required(kind):
            raise KindError(
                f'{inner}{key}: expected {_words(hint)}, got none: is the file of another version?'
            )


@functools.cache  # to evaluate the annotations takes longer than all checks
def _fields(kind: Any) -> Mapping[str, Any]:
    return get_type_hints(kind)


def _required(kind: Any) -> frozenset[str]:
    if is_typeddict(kind):
        return frozenset(kind.__required_keys__)
    return frozenset(kind._fields) - frozenset(kind._field_defaults)


def _refused(value: Any, kind: Any, name: str) -> KindError:
    prefix = f'{name}: ' if name else ''
    return KindError(f'{prefix}expected {_words(kind)}, got {_short(value)}')


def _short(value: Any) -> str:
    if isinstance(value, int) and abs(value) >= _LARGEST:
        return 'one beyond 64 bits'
    return 'nothing' if value is None else f'{value!r:.80}'


def _words(kind: Any) -> str:
    """Return a kind in words."""
    if len(kinds := _kinds(kind)) > 1:
        return ' or '.join(dict.fromkeys(map(_words, kinds)))
    if get_origin(kind) is list:
        return 'a list'
    return 'names and values' if _is_mapping(kind) else _WORDS.get(kind, 'any value')
