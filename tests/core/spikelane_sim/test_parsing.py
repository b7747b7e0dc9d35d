"""Parsing what others wrote: limits hold, and every refusal is one reason."""

from __future__ import annotations

from pathlib import Path

import pytest

from spikelane_sim.errors import CourseError
from spikelane_sim.parsing import parse_json, parse_yaml, ParseError, read_json_file
from spikelane_sim.yaml_file import read_yaml

_BOMB = 'a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n' + ''.join(
    f'{name}: &{name} [{", ".join([f"*{before}"] * 10)}]\n'
    for before, name in zip('abcdefgh', 'bcdefghi', strict=True)
)
_MERGE_BOMB = 'a: &a {k: 1}\n' + ''.join(
    f'{name}: &{name} {{<<: [{", ".join([f"*{before}"] * 10)}]}}\n'
    for before, name in zip('abcdefgh', 'bcdefghi', strict=True)
)


@pytest.mark.parametrize('depth', [33, 1000, 100_000])
@pytest.mark.parametrize('parse', [parse_json, parse_yaml])
def test_what_is_nested_too_deep_is_refused(parse, depth: int) -> None:
    """33 lists, or 100,000, give the same error and no RecursionError."""
    with pytest.raises(ParseError, match='nested 32 deep at most'):
        parse('[' * depth + '1' + ']' * depth)


@pytest.mark.parametrize('parse', [parse_json, parse_yaml])
def test_what_is_nested_32_deep_is_read(parse) -> None:
    """The limit itself is allowed."""
    value = parse('[' * 32 + '1' + ']' * 32)
    for _ in range(32):
        [value] = value
    assert value == 1


@pytest.mark.parametrize('text', ['- ' * 100, '? ' * 100, '&a [*a]', 'a: &a {b: *a}'])
def test_depth_in_yaml_is_limited_in_every_style(text: str) -> None:
    """Blocks, keys and aliases of what they are in count as well as brackets."""
    with pytest.raises(ParseError, match='nested 32 deep at most'):
        parse_yaml(text)


@pytest.mark.parametrize('text', [_BOMB, _MERGE_BOMB])
def test_aliases_that_multiply_are_refused(text: str) -> None:
    """Ten to the ninth values in nine lines are not written out."""
    with pytest.raises(ParseError, match='at most 300000 values'):
        parse_yaml(text)


@pytest.mark.parametrize(
    'text',
    [
        '!!timestamp foo',
        '1:' + '59:' * 999 + '59.5',
        '!!int ""',
        '!!bool foo',
        '!!float ""',
        '!!int foo',
        '!!set [a]',
        '{[a]: b}',
    ]
    + ['!!timestamp 2001-99-99', '!!python/object:x 1', '<<: 3', '\x00', '\ud800', '=', 'a: b: c'],
)
def test_a_value_that_is_none_of_yaml_gives_one_error(text: str) -> None:
    """Whatever PyYAML raises for it."""
    with pytest.raises(ParseError, match=r'^not YAML: [^\n]+$'):
        parse_yaml(text)


@pytest.mark.parametrize('text', ['', '{', '9' * 5000 + 'x', '"\\ud800"', b'\xff', '{"a": 1'])
def test_a_text_that_is_not_json_gives_one_error(text: str | bytes) -> None:
    """Also where it is not UTF-8, or could not be written as such."""
    with pytest.raises(ParseError, match=r'^[^\n]+$'):
        parse_json(text)


def test_a_file_for_people_says_where_it_is_nested_too_deep(tmp_path: Path) -> None:
    """The error names the file and the line."""
    path = tmp_path / 'course.yaml'
    path.write_text('name: deep\nparts: ' + '[' * 50)
    with pytest.raises(CourseError, match=r'course\.yaml:2: .* nested 32 deep at most'):
        read_yaml(path, 'a course', CourseError)


def test_a_file_that_is_not_there_says_so(tmp_path: Path) -> None:
    """The system's own reason is given."""
    with pytest.raises(ParseError, match='cannot be read: No such file'):
        read_json_file(tmp_path / 'none.json')
