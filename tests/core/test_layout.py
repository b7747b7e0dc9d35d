"""The folders of tests mirror the folders that they test."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
KINDS = ('core', 'ros')
#: Where the counterpart of each folder in tests/core and tests/ros is.
COUNTERPARTS = {
    'spikelane_sim': 'sim_bridge/spikelane_sim',
    'spikelane_controllers': 'controllers/spikelane_controllers',
    'spikelane': 'ros2_ws/src/spikelane/spikelane',
    'spikelane_benches': 'benches/spikelane_benches',
    'docs': 'docs',
    'msgs': 'msgs',
    'setup': 'setup',
}


def folders_without_counterpart(tests: Path, root: Path) -> Iterator[str]:
    """Yield the folders of Python files below `tests` that mirror no folder below `root`."""
    for folder in sorted({file.parent for file in tests.rglob('*.py')} - {tests}):
        first, *others = folder.relative_to(tests).parts
        counterpart = root.joinpath(COUNTERPARTS.get(first, 'no counterpart'), *others)
        if not counterpart.is_dir():
            yield str(folder.relative_to(tests))


@pytest.mark.parametrize('kind', KINDS)
def test_each_folder_of_tests_mirrors_a_folder_that_it_tests(kind: str) -> None:
    """`tests/core/spikelane_sim/filters` has the tests of `sim_bridge/spikelane_sim/filters`."""
    assert list(folders_without_counterpart(ROOT / 'tests' / kind, ROOT)) == []


def test_a_folder_that_mirrors_nothing_is_found(tmp_path: Path) -> None:
    """Neither a folder of an unknown package nor one of an unknown part of a package passes."""
    for name in ('filters', 'spikelane_sim/filters', 'spikelane_sim/lenses'):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / 'test_some.py').touch()
    assert list(folders_without_counterpart(tmp_path, ROOT)) == ['filters', 'spikelane_sim/lenses']


def test_at_the_top_are_only_rules_for_the_whole_repository() -> None:
    """A test of one module belongs in the folder of its package."""
    top = {file.name for kind in KINDS for file in (ROOT / 'tests' / kind).glob('test_*.py')}
    assert top == {
        'test_citation.py',
        'test_construction.py',
        'test_core_is_free_of_ros.py',
        'test_layout.py',
        'test_rclpy_internals.py',
        'test_skips.py',
        'test_topic_names.py',
    }


def modules() -> Iterator[Path]:
    """Yield the files of Python that are no tests."""
    for folder in COUNTERPARTS.values():
        yield from ROOT.joinpath(folder).rglob('*.py')


def code_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return how many lines a function has without its docstring."""
    first = function.body[0]
    is_docstring = ast.get_docstring(function) is not None
    docstring = first.end_lineno - first.lineno + 1 if is_docstring and first.end_lineno else 0
    assert function.end_lineno
    return function.end_lineno - function.lineno + 1 - docstring


def test_modules_and_functions_are_as_short_as_contributing_says() -> None:
    """Modules have at most 450 lines, scripts 520, and functions 70."""
    found, functions = [*modules()], 0
    assert len(found) > 300
    for file in found:
        text = file.read_text('utf-8')
        is_script = file.is_relative_to(ROOT / 'docs') or file.is_relative_to(ROOT / 'setup')
        assert len(text.splitlines()) <= (520 if is_script else 450), file
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                functions += 1
                assert code_lines(node) <= 70, f'{file}: {node.name}'
    assert functions > 2000
