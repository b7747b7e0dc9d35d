"""Parameters: frozen dataclasses whose fields know their meaning, unit, range and source.

Declared once, here in the core; ROS parameters, YAML files, command-line flags and the metadata
of bags and checkpoints are all made from `Parameters.specs()`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import dataclasses
import functools
import math
from types import MappingProxyType
from typing import Any, ClassVar, get_args, get_origin, get_type_hints, TypeVar

import numpy as np

from spikelane_sim.errors import ParameterError

#: Steps of anything: 10^9 actions would take days.
MOST_STEPS = 10**9

#: When a change of a parameter takes effect, for those that may be changed; see
#: `parameter_changes`.
NEXT_STEP, NEXT_EPISODE = 'next step', 'next episode'

ParametersT = TypeVar('ParametersT', bound='Parameters')

# The kinds of value a parameter can have: what ROS parameters, YAML and command lines share.
_KIND_NAMES = {
    bool: 'true or false',
    int: 'a whole number',
    float: 'a number',
    str: 'a text',
}
_LIST_NAMES = {float: 'a list of numbers', str: 'a list of texts'}


@dataclasses.dataclass(frozen=True)
class ParameterSpec:
    """What is known of one parameter.

    Attributes:
        name: Dotted name, `camera.width` for a field of nested parameters.
        kind: bool, int, float, str, or tuple for a list.
        default: Value used where none is given.
        description: What it means, one sentence.
        unit: SI unit, empty for pure numbers.
        low: Smallest allowed value, None for no bound.
        high: Largest allowed value, None for no bound.
        choices: Allowed texts, empty for any.
        ending: What the paths of files end with that are allowed in addition to the choices,
            empty for none.
        source: Where the default comes from (a place in the paper), empty for our own choice.
        item: Type of a list's items: float or str.
        changes: When a change takes effect, NEXT_STEP or NEXT_EPISODE; empty where the value is
            fixed once it is in use.
    """

    name: str
    kind: type
    default: Any
    description: str
    unit: str = ''
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    ending: str = ''
    source: str = ''
    item: type = float
    changes: str = ''

    @property
    def allowed(self) -> str:
        """The allowed values in words, for messages, help texts and parameter descriptors."""
        if self.choices:
            file = f', or the path of a {self.ending} file' if self.ending else ''
            return f'one of {", ".join(self.choices)}{file}'
        unit = f' {self.unit}' if self.unit else ''
        kind = _LIST_NAMES[self.item] if self.kind is tuple else _KIND_NAMES[self.kind]
        if self.low is not None and self.high is not None:
            return f'{kind} from {_number(self.low)} to {_number(self.high)}{unit}'
        if self.low is not None:
            return f'{kind} of at least {_number(self.low)}{unit}'
        if self.high is not None:
            return f'{kind} of at most {_number(self.high)}{unit}'
        return f'{kind}{f" [{self.unit}]" if self.unit else ""}'

    def check(self, value: object) -> Any:
        """Return the value in this parameter's kind.

        Raises:
            ParameterError: The value is of another kind or not allowed.
        """
        converted = _convert(self.kind, value, self.item)
        if converted is None or not self._is_allowed(converted):
            raise ParameterError(f'{self.name}: expected {self.allowed}, got {value!r:.200}')
        return converted

    def _is_allowed(self, value: Any) -> bool:
        if self.choices:
            is_file = bool(self.ending) and value.endswith(self.ending)
            return is_file or value in self.choices
        numbers = value if self.kind is tuple else (value,)
        if self.kind not in (int, float, tuple) or (self.kind is tuple and self.item is str):
            return True
        return all(
            (isinstance(number, int) or math.isfinite(number))
            and (self.low is None or number >= self.low)
            and (self.high is None or number <= self.high)
            for number in numbers
        )


def parameter(
    default: Any,
    description: str,
    *,
    unit: str = '',
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    ending: str = '',
    source: str = '',
    changes: str = '',
) -> Any:
    """Declare a field of a `Parameters` class; see `ParameterSpec` for the arguments."""
    metadata = {
        'description': description,
        'unit': unit,
        'low': low,
        'high': high,
        'choices': choices,
        'ending': ending,
        'source': source,
        'changes': changes,
    }
    return dataclasses.field(default=default, metadata=metadata)


def nested(parameters: type[ParametersT]) -> Any:
    """Declare a field that holds another `Parameters` class, at its defaults."""
    return dataclasses.field(default_factory=parameters)


def with_groups(
    groups: Mapping[str, type[Parameters]],
) -> Callable[[type[ParametersT]], type[ParametersT]]:
    """Return a decorator, applied before `dataclass`, that adds a `nested` field for each group.

    It is for groups that are known only when the program runs, as those of other packages.
    """

    def add(cls: type[ParametersT]) -> type[ParametersT]:
        cls.__annotations__ = {**cls.__annotations__, **groups}
        for name, group in groups.items():
            setattr(cls, name, nested(group))
        return cls

    return add


class Parameters:
    """Base of the frozen dataclasses that hold parameters; validates on construction.

    Subclasses are `@dataclass(frozen=True, kw_only=True)` whose fields are made by `parameter`
    or `nested`. Relations between fields are checked in `_check_relations`.

    Attributes:
        former_names: Today's names of parameters, by the names that they had in earlier versions.
            What is in files and on command lines may have either.
    """

    former_names: ClassVar[Mapping[str, str]] = {}

    def __post_init__(self) -> None:
        """Check every field against its declaration.

        Raises:
            ParameterError: A value is of the wrong kind or outside its range.
        """
        for spec in _own_specs(type(self)):
            object.__setattr__(self, spec.name, spec.check(getattr(self, spec.name)))
        self._check_relations()

    def _check_relations(self) -> None:
        """Raise ParameterError where fields contradict each other."""

    @classmethod
    def specs(cls, prefix: str = '') -> Iterator[ParameterSpec]:
        """Yield what is known of every parameter, nested ones under dotted names."""
        for spec in _own_specs(cls):
            yield dataclasses.replace(spec, name=prefix + spec.name)
        for name, group in _groups(cls).items():
            yield from group.specs(f'{prefix}{name}.')

    @classmethod
    def accepted_specs(cls, prefix: str = '') -> Iterator[ParameterSpec]:
        """Yield what is known of every parameter that may be given: former names have it, too."""
        known = {spec.name: spec for spec in cls.specs()}
        for spec in _own_specs(cls):
            yield dataclasses.replace(spec, name=prefix + spec.name)
        for former, name in cls.former_names.items():
            yield dataclasses.replace(known[name], name=prefix + former)
        for name, group in _groups(cls).items():
            yield from group.accepted_specs(f'{prefix}{name}.')

    @classmethod
    def current(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return values by dotted names under today's names; unknown names stay as they are.

        Where both names of a parameter are given, the value under today's name counts.
        """
        former = {name: value for name, value in values.items() if name in cls.former_names}
        found = {cls.former_names[name]: value for name, value in former.items()}
        inner: dict[str, dict[str, Any]] = {name: {} for name in _groups(cls)}
        for name, value in values.items():
            group, _, rest = name.partition('.')
            if group in inner and rest:
                inner[group][rest] = value
            elif name not in former:
                found[name] = value
        for name, group_cls in _groups(cls).items():
            new = group_cls.current(inner[name])
            found |= {f'{name}.{rest}': value for rest, value in new.items()}
        return found

    @classmethod
    def chosen_defaults(cls, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the defaults that depend on what is given, by dotted names.

        Args:
            values: What is given, by dotted names, not checked yet.
        """
        del values
        return {}

    @classmethod
    def from_mapping(
        cls: type[ParametersT], values: Mapping[str, Any], where: str = ''
    ) -> ParametersT:
        """Make parameters from dotted names or nested mappings; what is absent is default.

        Args:
            values: `{'camera.width': 128}` or `{'camera': {'width': 128}}`.
            where: Named in front of an error, a file's path say.

        Raises:
            ParameterError: A name is unknown, or a value not allowed.
        """
        flat = cls.current(flatten(values))
        flat = {**cls.chosen_defaults(flat), **flat}
        known = {spec.name: spec for spec in cls.specs()}
        prefix = f'{where}: ' if where else ''
        for name in flat:
            if name not in known:
                allowed = ', '.join(known)
                raise ParameterError(f'{prefix}unknown parameter {name!r}; expected {allowed}')
        try:
            checked = {name: known[name].check(value) for name, value in flat.items()}
            return _build(cls, checked, '')
        except ParameterError as error:
            raise ParameterError(f'{prefix}{error}') from None

    def to_dict(self) -> dict[str, Any]:
        """Return all values under their dotted names, ready for YAML or JSON."""
        values = {}
        for spec in type(self).specs():
            value: Any = self
            for part in spec.name.split('.'):
                value = getattr(value, part)
            values[spec.name] = list(value) if spec.kind is tuple else value
        return values


def check_size(what: str, factors: Mapping[str, float], most: float) -> None:
    """Check that parameters which multiply do not ask for too much memory or time.

    Args:
        what: What they make so many of.
        factors: By the names of the parameters.
        most: Largest product allowed.

    Raises:
        ParameterError: Their product is larger.
    """
    product = math.prod(factors.values())
    if product > most:
        given = ' x '.join(_number(value) for value in factors.values())
        raise ParameterError(
            f'{", ".join(factors)}: expected at most {most:,.0f} {what}, '
            f'got {given} = {product:,.0f}'
        )


def flatten(values: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Return nested values under dotted names: `{'camera': {'width': 128}}` as `camera.width`."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            found |= flatten(value, f'{prefix}{name}.')
        else:
            found[f'{prefix}{name}'] = value
    return found


def grouped(values: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return values under dotted names by their group: by the name's first part, under the rest.

    A name without a point is a group that has one value, under ''.
    """
    found: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        group, _, rest = name.partition('.')
        found.setdefault(group, {})[rest] = value
    return found


def first_difference(name: str, one: Any, other: Any) -> tuple[str, Any, Any]:
    """Return where two values differ, down to a name in mappings, and either's value there."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in (*one, *other):
            if one.get(key) != other.get(key):
                return first_difference(f'{name}.{key}', one.get(key), other.get(key))
    return name, one, other


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else f'{value:.15g}'


def _convert(kind: type, value: object, item: type = float) -> Any:
    """Return the value as `kind`, or None where that would lose or invent something."""
    if isinstance(value, np.generic):
        value = value.item()
    if kind is tuple:
        if isinstance(value, str) or not hasattr(value, '__iter__'):
            return None
        items = tuple(_convert(item, each) for each in value)
        return None if None in items else items
    if isinstance(value, kind) and not (kind is int and isinstance(value, bool)):
        return value
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return _float(value)
    return None


def _float(value: int) -> float | None:
    try:
        return float(value)
    except OverflowError:
        return None


def _find_specs(cls: type) -> tuple[ParameterSpec, ...]:
    hints = get_type_hints(cls)
    specs = []
    for field in dataclasses.fields(cls):
        if field.metadata:
            hint = hints[field.name]
            kind, item = get_origin(hint) or hint, (*get_args(hint), float)[0]
            specs.append(
                ParameterSpec(field.name, kind, field.default, item=item, **field.metadata)
            )
    return tuple(specs)


def _find_groups(cls: type) -> Mapping[str, type[Parameters]]:
    hints = get_type_hints(cls)
    return MappingProxyType(
        {field.name: hints[field.name] for field in dataclasses.fields(cls) if not field.metadata}
    )


# To evaluate the annotations takes longer than all checks: once for each class is enough.
_own_specs: Callable[[type], tuple[ParameterSpec, ...]] = functools.cache(_find_specs)
_groups: Callable[[type], Mapping[str, type[Parameters]]] = functools.cache(_find_groups)


def _build(cls: type[ParametersT], flat: Mapping[str, Any], prefix: str) -> ParametersT:
    own = {spec.name for spec in _own_specs(cls)}
    values = {name: flat[prefix + name] for name in own if prefix + name in flat}
    groups = {
        name: _build(group, flat, f'{prefix}{name}.') for name, group in _groups(cls).items()
    }
    return cls(**values, **groups)
