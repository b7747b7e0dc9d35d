"""JSON and YAML that others wrote: parsed with limits, and refused with one reason.

Every text that does not come from this process goes through here. A document must not be nested
deeper than MAX_DEPTH, and the aliases of YAML must not make it longer than MAX_VALUES.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import json
import math
from pathlib import Path
from typing import Any

import yaml

from spikelane_sim.errors import SpikelaneError

#: Lists and mappings within each other. Our own files have at most 6.
MAX_DEPTH = 32

#: Values in a YAML document once all aliases are written out.
MAX_VALUES = 300_000

# A whole number beyond would fail wherever it becomes a float or a part of an array.
_SMALLEST, _LARGEST = -(2**63), 2**64 - 1

# LibYAML reads many files in a fraction of the time, where PyYAML has it.
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


class ParseError(SpikelaneError):
    """A text is not what its format allows, or exceeds a limit.

    Attributes:
        line: Where, counted from 1; None where that is unknown.
    """

    exit_status = 1

    def __init__(self, reason: str, line: int | None = None) -> None:
        """Keep reason and line."""
        super().__init__(reason)
        self.line = line


def parse_json(text: str | bytes) -> Any:
    """Return what a JSON text says.

    Raises:
        ParseError: It is not JSON, not UTF-8, nested too deeply, or has a number that is not
            finite or a whole number beyond 64 bits.
    """
    try:
        value = json.loads(text)
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:  # UnicodeDecodeError and numbers of too many digits too
        raise ParseError(f'not JSON: {_reason(error)}') from None
    _check_size(value, None, _json_items)
    return value


def parse_yaml(text: str) -> Any:
    """Return what a YAML text says, as dicts, lists, texts, numbers and dates.

    Raises:
        ParseError: It is not YAML, a value does not fit its tag, or it exceeds a limit, as whole
            numbers beyond 64 bits do.
    """
    node = _compose(text, _LOADER)
    return None if node is None else construct_yaml(node)


def construct_yaml(node: yaml.Node) -> Any:
    """Return the value of a node of `parse_yaml` or `compose_yaml_file`.

    Raises:
        ParseError: It does not fit its tag.
    """
    loader = yaml.SafeLoader('')
    try:
        value = loader.construct_document(node)
    except yaml.YAMLError as error:
        raise _yaml_error(error) from None
    except (ValueError, OverflowError) as error:  # of `1:59:59.9` with very many parts, too
        raise ParseError(f'not YAML: {_reason(error)}') from None
    except (AttributeError, LookupError, TypeError):  # of PyYAML, for `!!timestamp foo`
        raise ParseError('not YAML: a value does not fit its tag') from None
    finally:
        loader.dispose()
    _check_size(value, None, _items)
    return value


def read_json_file(path: Path) -> Any:
    """Return what a JSON file says.

    Raises:
        ParseError: It cannot be read, or as in `parse_json`; the path is not named.
    """
    return parse_json(_read_text(path))


def read_yaml_file(path: Path) -> Any:
    """Return what a YAML file says.

    Raises:
        ParseError: It cannot be read, or as in `parse_yaml`; the path is not named.
    """
    return parse_yaml(_read_text(path))


def compose_yaml_file(path: Path) -> yaml.Node | None:
    """Return the tree of a YAML file, whose nodes know their lines; None for an empty file.

    Raises:
        ParseError: It cannot be read, is not YAML, or exceeds a limit; the path is not named.
    """
    return _compose(_read_text(path), yaml.SafeLoader)


def _yaml_error(error: yaml.YAMLError) -> ParseError:
    """Return PyYAML's error as one line."""
    mark = getattr(error, 'problem_mark', None)
    problem = getattr(error, 'problem', None) or str(error).partition('\n')[0]
    return ParseError(f'not YAML: {problem}', mark.line + 1 if mark else None)


def _read_text(path: Path) -> str:
    try:
        return path.read_text('utf-8')
    except OSError as error:
        raise ParseError(f'cannot be read: {error.strerror}') from None
    except UnicodeDecodeError:
        raise ParseError('expected a text in UTF-8') from None


def _compose(text: str, loader: Any) -> yaml.Node | None:
    """Return the tree of a YAML text, None where it is empty.

    It is checked before values are made of it: merged keys (`<<`) would multiply there.
    """
    _check_yaml_depth(text, loader)
    try:
        node: yaml.Node | None = yaml.compose(text, Loader=loader)
    except yaml.YAMLError as error:
        raise _yaml_error(error) from None
    _check_size(node, MAX_VALUES, _nodes)
    return node


def _check_yaml_depth(text: str, loader: Any) -> None:
    """Check that a text is YAML nested no deeper than MAX_DEPTH, before a tree is made of it.

    PyYAML's composer is recursive, its parser is not.

    Raises:
        ParseError: It is not, or it is no YAML at all.
    """
    depth = 0
    try:
        for event in yaml.parse(text, Loader=loader):
            if isinstance(event, yaml.CollectionStartEvent):
                depth += 1
                if depth > MAX_DEPTH:
                    raise _too_deep(event.start_mark.line + 1)
            elif isinstance(event, yaml.CollectionEndEvent):
                depth -= 1
    except yaml.YAMLError as error:
        raise _yaml_error(error) from None
    except UnicodeEncodeError:  # half a surrogate pair, which no file in UTF-8 holds
        raise ParseError('not YAML: expected a text that UTF-8 can encode') from None


def _reason(error: ValueError | OverflowError) -> str:
    reason = str(error)
    return 'a whole number of too many digits' if 'set_int_max_str_digits' in reason else reason


def _too_deep(line: int | None = None) -> ParseError:
    return ParseError(f'expected lists and mappings nested {MAX_DEPTH} deep at most', line)


def _check_size(value: Any, most: int | None, inner: Callable[[Any], Iterator[Any]]) -> None:
    """Check depth and number of values; without recursion, so that no depth is too much."""
    count = 0
    stack = [(value, 0)]
    while stack:
        each, depth = stack.pop()
        count += 1
        if most is not None and count > most:
            raise ParseError(f'expected at most {most} values, aliases written out')
        items = [(item, depth + 1) for item in inner(each)]
        if items and depth == MAX_DEPTH:
            raise _too_deep()
        stack.extend(items)


def _items(value: Any) -> Iterator[Any]:
    if isinstance(value, str) and not value.isascii():
        try:
            value.encode()
        except UnicodeEncodeError:
            raise ParseError('expected texts that UTF-8 can encode') from None
    elif isinstance(value, int) and not _SMALLEST <= value <= _LARGEST:
        raise ParseError('expected whole numbers of at most 64 bits')
    elif isinstance(value, Mapping):
        yield from value
        yield from value.values()
    elif isinstance(value, (list, tuple, set)):
        yield from value


def _json_items(value: Any) -> Iterator[Any]:
    # Python reads NaN, Infinity and 1e999, which JSON lacks and we never write.
    if isinstance(value, float) and not math.isfinite(value):
        raise ParseError(f'not JSON: expected finite numbers, got {value}')
    return _items(value)


def _nodes(node: Any) -> Iterator[Any]:
    if isinstance(node, yaml.MappingNode):
        for pair in node.value:
            yield from pair
    elif isinstance(node, yaml.SequenceNode):
        yield from node.value
