"""How objects are constructed: a class never counts on what a base's __init__ will call."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted(
    path
    for folder in ('sim_bridge/spikelane_sim', 'controllers/spikelane_controllers', 'ros2_ws/src')
    for path in (ROOT / folder).rglob('*.py')
    if 'build' not in path.parts
)


def fields_set_too_early(text: str) -> Iterator[str]:
    """Yield statements with `self` that come before `super().__init__`."""
    functions = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef))
    for function in functions:
        lines = [ast.unparse(statement) for statement in function.body]
        ends = [number for number, line in enumerate(lines) if 'super().__init__(' in line]
        if function.name == '__init__' and ends:
            yield from (line for line in lines[: ends[0]] if 'self.' in line)


@pytest.mark.parametrize('path', SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_object_sets_fields_before_its_base_is_made(path: Path) -> None:
    """Otherwise the order of lines in a base decides whether a class works."""
    assert list(fields_set_too_early(path.read_text('utf-8'))) == []


def test_such_a_field_is_found() -> None:
    """The search is run on an example."""
    text = 'class A(B):\n    def __init__(self):\n        self.x = 1\n        super().__init__()\n'
    assert list(fields_set_too_early(text)) == ['self.x = 1']
