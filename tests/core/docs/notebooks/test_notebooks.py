"""The notebooks run, and are committed without output."""

from __future__ import annotations

from pathlib import Path

from nbclient import NotebookClient
import nbformat
import pytest

NOTEBOOKS = Path(__file__).parents[4] / 'docs/notebooks'
#: What each one shows when it is run.
SHOWN = {
    'first_lap': ("'completed': True", 'laps_complete'),
    'own_controller': ("'completed': True", 'inner       True'),
    'statistics': ('8 of 8', 'p-value'),
}


def test_all_notebooks_are_run() -> None:
    """By the test below."""
    assert {file.stem for file in NOTEBOOKS.glob('*.ipynb')} == set(SHOWN)


@pytest.mark.parametrize('name', SHOWN)
def test_a_notebook_is_committed_without_output(name: str) -> None:
    """Outputs would be stale at the next change, and make every diff large."""
    notebook = nbformat.read(NOTEBOOKS / f'{name}.ipynb', as_version=4)
    assert set(notebook.metadata) == {'kernelspec', 'language_info'}
    assert set(notebook.metadata.language_info) == {'name'}
    for cell in notebook.cells:
        assert not cell.metadata
        if cell.cell_type == 'code':
            assert (cell.outputs, cell.execution_count) == ([], None)


@pytest.mark.slow
@pytest.mark.parametrize('name', SHOWN)
def test_a_notebook_runs(tmp_path: Path, name: str) -> None:
    """Every cell, with the results that its text is about."""
    notebook = nbformat.read(NOTEBOOKS / f'{name}.ipynb', as_version=4)
    resources = {'metadata': {'path': str(tmp_path)}}
    NotebookClient(notebook, timeout=200, resources=resources).execute()
    code = [cell for cell in notebook.cells if cell.cell_type == 'code']
    outputs = [output for cell in code for output in cell.outputs]
    assert any('image/png' in output.get('data', {}) for output in outputs)
    texts = '\n'.join(output.get('data', {}).get('text/plain', '') for output in outputs)
    for words in SHOWN[name]:
        assert words in texts
