"""YAML files for people: every value knows its line, and says it when it is refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import yaml

from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.parameters import ParameterSpec
from spikelane_sim.parsing import compose_yaml_file, construct_yaml, ParseError


def read_yaml(path: Path, what: str, error: type[SpikelaneError]) -> YamlValue:
    """Read a file.

    Args:
        path: The file.
        what: It should describe, for the message that it is empty.
        error: What is raised, by the value returned too.

    Raises:
        SpikelaneError: The file cannot be read, or is not YAML; an error of the class given.
    """
    try:
        tree = compose_yaml_file(path)
    except ParseError as cause:
        line = '' if cause.line is None else f':{cause.line}'
        raise error(f'{path}{line}: {cause}') from None
    if tree is None:
        raise error(f'{path}: expected {what}, got an empty file')
    return YamlValue(tree, str(path), '', error)


#: Most digits of a whole number; Python refuses to read more than some thousand.
_MOST_DIGITS = 30


class YamlValue:
    """A value in a file, which knows where it stands.

    Attributes:
        where: The file.
        name: Name of the value in the file, `lanes.outer.start`; '' for all of it.
    """

    def __init__(self, node: Any, where: str, name: str, error: type[SpikelaneError]) -> None:
        self._node = node
        self.where = where
        self.name = name
        self._error = error

    @property
    def place(self) -> str:
        """File and line."""
        return f'{self.where}:{self._node.start_mark.line + 1}'

    @property
    def is_list(self) -> bool:
        """Whether it is a list."""
        return isinstance(self._node, yaml.SequenceNode)

    @property
    def is_mapping(self) -> bool:
        """Whether it is a mapping."""
        return isinstance(self._node, yaml.MappingNode)

    def fail(self, expected: str) -> NoReturn:
        """Refuse the value."""
        got = self._node.value
        if not isinstance(self._node, yaml.ScalarNode):
            got = 'a mapping' if isinstance(self._node, yaml.MappingNode) else 'a list'
        else:
            got = repr(got) if got else 'nothing'
        name = f'{self.name}: ' if self.name else ''
        raise self._error(f'{self.place}: {name}expected {expected}, got {got}')

    def refuse(self, reason: object) -> NoReturn:
        """Refuse the value for a reason that says what was expected and what came."""
        raise self._error(f'{self.place}: {reason}')

    def fields(self, required: str = '', optional: str = '') -> dict[str, YamlValue]:
        """Return the values of a mapping that has these keys (separated by spaces)."""
        needed, known = required.split(), required.split() + optional.split()
        found = dict(self.entries())
        for name, value in found.items():
            if name not in known:
                of = f' of {self.name}' if self.name else ''
                value.refuse(f'unknown key {name!r}{of}, expected {", ".join(known)}')
        for name in needed:
            if name not in found:
                self.fail(f'the key {name!r}')
        return found

    def entries(self) -> Iterator[tuple[str, YamlValue]]:
        """Yield keys and values of a mapping."""
        if not isinstance(self._node, yaml.MappingNode):
            self.fail('a mapping')
        seen = set()
        for key, node in self._node.value:
            name = YamlValue(key, self.where, f'key of {self.name}', self._error).text()
            inner = f'{self.name}.{name}' if self.name else name
            value = YamlValue(node, self.where, inner, self._error)
            if name in seen:
                value.refuse(f'{inner}: given twice')
            seen.add(name)
            yield name, value

    def items(self) -> list[YamlValue]:
        """Return the values of a list."""
        if not isinstance(self._node, yaml.SequenceNode):
            self.fail('a list')
        return [
            YamlValue(node, self.where, f'{self.name}[{i}]', self._error)
            for i, node in enumerate(self._node.value)
        ]

    def number(self, low: float, high: float) -> float:
        """Return a number within these limits."""
        expected = f'a number from {low:g} to {high:g}'
        if not isinstance(self._node, yaml.ScalarNode) or self._node.style is not None:
            self.fail(expected)
        try:
            number = float(self._node.value)
        except ValueError:
            self.fail(expected)
        if not low <= number <= high:  # NaN neither
            self.fail(expected)
        return number

    def whole_number(self, low: int, high: int) -> int:
        """Return a whole number within these limits."""
        expected = f'a whole number from {low} to {high}'
        is_plain = isinstance(self._node, yaml.ScalarNode) and self._node.style is None
        text = self._node.value if is_plain else ''
        if not text.isdecimal() or len(text) > _MOST_DIGITS:
            self.fail(expected)
        number = int(text)
        if not low <= number <= high:
            self.fail(expected)
        return number

    def text(self) -> str:
        """Return a text that is not empty."""
        is_text = isinstance(self._node, yaml.ScalarNode) and self._node.tag.endswith(':str')
        if not is_text or not self._node.value.strip():
            self.fail('a text')
        return str(self._node.value).strip()

    def scalar(self, expected: str) -> str:
        """Return what stands there for a text or a number, as it is written."""
        if not isinstance(self._node, yaml.ScalarNode) or not self._node.value.strip():
            self.fail(expected)
        return str(self._node.value).strip()

    def choice(self, *choices: str) -> str:
        """Return one of these texts."""
        if not isinstance(self._node, yaml.ScalarNode) or self._node.value not in choices:
            self.fail(' or '.join(choices))
        return str(self._node.value)

    def parameter(self, spec: ParameterSpec) -> Any:
        """Return the value of a parameter."""
        try:
            value = construct_yaml(self._node)
        except ParseError:  # a date that is none, say
            self.fail(spec.allowed)
        if spec.kind is float and isinstance(value, str):
            # YAML 1.1 wants a point and a sign (1.0e-3); JSON and people do not.
            value = self.number(float('-inf'), float('inf'))
        try:
            return spec.check(value)
        except ParameterError as error:
            self.refuse(error)
