"""What rclpy does not promise is used in one module."""

import ast
from collections.abc import Iterator
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).parents[2]
ONLY = 'sim_bridge/spikelane_sim/nodes/rclpy_internals.py'
MODULES = [
    path
    for folder in ('sim_bridge', 'controllers', 'ros2_ws/src/spikelane', 'docs')
    for path in sorted((ROOT / folder).rglob('*.py'))
    if 'rclpy' in path.read_text('utf-8') and str(path.relative_to(ROOT)) != ONLY
]

#: Names with an underscore that named tuples and the standard library have in public.
PUBLIC = ('_replace', '_asdict', '_fields', '_exit')
COMPILED = re.compile(r'rclpy\.(impl\b|guard_condition$)')


def internals(source: str) -> Iterator[str]:
    """Yield uses of handles, of underscored names of other objects, and of the compiled part."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute):
            is_own = ast.unparse(node.value) in ('self', 'cls', 'super()')
            is_underscored = re.match('_[^_]', node.attr) and node.attr not in PUBLIC
            if node.attr == 'handle' or (is_underscored and not is_own):
                yield ast.unparse(node)
        elif isinstance(node, ast.ImportFrom) and COMPILED.match(node.module or ''):
            yield ast.unparse(node)


def test_the_search_finds_what_it_looks_for() -> None:
    """It finds each kind of use in the one module that may have them."""
    found = set(internals((ROOT / ONLY).read_text('utf-8')))
    assert {
        'subscription.handle',
        'node._parameter_overrides',
        'from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy',
    } <= found


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_other_module_uses_the_internals_of_rclpy(path: Path) -> None:
    """A new version of rclpy then concerns one module."""
    assert list(internals(path.read_text('utf-8'))) == []
