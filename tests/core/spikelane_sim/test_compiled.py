"""Functions without a way into them from Python are called by compiled functions alone."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
import sys
from typing import Any, NamedTuple

import numba
from numba.core.errors import LoweringError, NumbaRuntimeError, TypingError
import numpy as np
import pytest

from spikelane_sim.compiled import inner, uncounted

ROOT = Path(__file__).parents[3]
PACKAGES = {
    'spikelane_sim': ROOT / 'sim_bridge',
    'spikelane_controllers': ROOT / 'controllers',
    'spikelane': ROOT / 'ros2_ws/src/spikelane',
    'spikelane_benches': ROOT / 'benches',
}


#: Decorators of such functions.
INNER = ('inner', 'inlined', 'uncounted')


class Use(NamedTuple):
    """A place in Python where a name of a module is used."""

    module: str
    name: str
    where: str


def modules() -> dict[str, ast.Module]:
    """Return all modules and tests, by the names that they are imported under."""
    files = {
        '.'.join(file.relative_to(folder).with_suffix('').parts): file
        for package, folder in PACKAGES.items()
        for file in folder.glob(f'{package}/**/*.py')
    }
    others = [*ROOT.glob('tests/**/*.py'), *ROOT.glob('docs/**/*.py')]
    files |= {str(file.relative_to(ROOT)): file for file in others}
    return {name: ast.parse(file.read_text('utf-8')) for name, file in files.items()}


def decorators(node: ast.AST) -> str:
    """Return the decorators of a function, '' for another node."""
    found = node.decorator_list if isinstance(node, ast.FunctionDef) else []
    return ' '.join(map(ast.unparse, found))


def uses(module: str, tree: ast.Module) -> Iterator[Use]:
    """Yield what a module's Python uses: compiled functions are passed over."""
    imported = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        given = decorators(node)
        if 'njit' in given or given.startswith(INNER):
            continue
        if isinstance(node, ast.Name):
            yield Use(*imported.get(node.id, (module, node.id)), module)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            package, name = imported.get(node.value.id, ('', node.value.id))
            yield Use(f'{package}.{name}', node.attr, module)
        waiting.extend(ast.iter_child_nodes(node))


@pytest.fixture(scope='module')
def trees() -> dict[str, ast.Module]:
    """Give all modules and tests."""
    return modules()


def test_python_calls_no_inner_function(trees: dict[str, ast.Module]) -> None:
    """It would crash: `compiled.inner`."""
    inner = {
        (module, node.name)
        for module, tree in trees.items()
        if module.partition('.')[0] in PACKAGES
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and decorators(node).startswith(INNER)
    }
    assert ('spikelane_sim.fleet.kernel', 'simulate') in inner
    assert ('spikelane_sim.fleet.kernel', '_see_changes') in inner
    assert ('spikelane_sim.raster', 'find_view') in inner
    found = [use for module, tree in trees.items() for use in uses(module, tree)]
    assert [use for use in found if (use.module, use.name) in inner] == []


def test_a_call_from_python_would_be_found() -> None:
    """By name, and as an attribute of its module; a compiled caller is none."""
    text = """
from spikelane_sim.fleet import kernel
from spikelane_sim.fleet.kernel import simulate as step

@numba.njit
def compiled():
    step()

def plain():
    kernel.simulate()
    step()
"""
    found = {use for use in uses('here', ast.parse(text)) if use.name == 'simulate'}
    assert found == {Use('spikelane_sim.fleet.kernel', 'simulate', 'here')}
    assert sum(use.name == 'simulate' for use in uses('here', ast.parse(text))) == 2


@inner
def _first_half(values):  # type: ignore[no-untyped-def]
    return values[: len(values) // 2]


@numba.njit
def _total(values):  # type: ignore[no-untyped-def]
    return values.sum()


@inner
def _sum(values):  # type: ignore[no-untyped-def]
    return values.sum()


@uncounted
def _returns_an_array(values):  # type: ignore[no-untyped-def]
    return 1, values[1:]


@uncounted
def _makes_an_array(values):  # type: ignore[no-untyped-def]
    return np.zeros(len(values)).sum()


@uncounted
def _gets_an_array(values):  # type: ignore[no-untyped-def]
    return _first_half(values).sum()


@uncounted
def _calls_a_plain_function(values):  # type: ignore[no-untyped-def]
    return _total(values)


@uncounted
def _calls_an_inner_function(values):  # type: ignore[no-untyped-def]
    return _sum(values[1:])


@pytest.mark.parametrize(
    ('function', 'error'),
    [
        (_returns_an_array, 'expected no array to be returned'),
        (_makes_an_array, 'NRT required but not enabled|Only accept returning of array'),
        (_gets_an_array, 'return no array, got one of _first_half'),
        (_calls_a_plain_function, 'return no array, got one of _total'),
    ],
)
def test_an_uncounted_function_that_would_have_to_count_is_refused(
    function: Any, error: str
) -> None:
    """Its references would be lost, or taken back twice."""

    @numba.njit
    def call(values):  # type: ignore[no-untyped-def]
        return function(values)

    with pytest.raises((TypingError, LoweringError, NumbaRuntimeError), match=error):
        call(np.arange(4.0))


def test_an_uncounted_function_leaves_its_callers_arrays_alone() -> None:
    """As many references after a thousand calls as before."""
    values = np.arange(4.0)

    @numba.njit
    def call(values):  # type: ignore[no-untyped-def]
        total = 0.0
        for _ in range(1000):
            total += _calls_an_inner_function(values)
        return total

    call(values)
    before = sys.getrefcount(values)
    assert call(values) == 6000.0
    assert sys.getrefcount(values) == before
