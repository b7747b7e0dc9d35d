"""Files written whole."""

import json
import os
from pathlib import Path

import pytest
import yaml

from spikelane_sim.files import (
    FileError,
    write_bytes_atomically,
    write_json,
    write_text_atomically,
    write_yaml,
)


def test_json_refuses_what_it_has_no_word_for(tmp_path: Path) -> None:
    """NaN is not JSON; the old file stays."""
    path = tmp_path / 'metrics.json'
    write_json(path, {'a': 1})
    with pytest.raises(FileError, match='cannot be written as JSON'):
        write_json(path, {'a': float('nan')})
    assert json.loads(path.read_text()) == {'a': 1}


def test_yaml_refuses_objects(tmp_path: Path) -> None:
    """No tags that another program would have to run code for."""
    with pytest.raises(FileError, match='cannot be written as YAML'):
        write_yaml(tmp_path / 'config.yaml', {'a': object()})


def test_floats_in_yaml_read_back_exactly(tmp_path: Path) -> None:
    """Small ones too, which YAML 1.1 takes for texts without a point."""
    values = {'a': 1e-05, 'b': 0.1 + 0.2, 'c': 1e22}
    write_yaml(tmp_path / 'config.yaml', values)
    assert yaml.safe_load((tmp_path / 'config.yaml').read_text()) == values


def test_nothing_is_left_next_to_a_file(tmp_path: Path) -> None:
    """The folder holds the file alone, written in UTF-8."""
    write_text_atomically(tmp_path / 'new' / 'note.txt', 'Straße\n')
    assert [path.name for path in (tmp_path / 'new').iterdir()] == ['note.txt']
    assert (tmp_path / 'new' / 'note.txt').read_bytes() == b'Stra\xc3\x9fe\n'


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is full when the bytes are flushed to it."""

    def full(descriptor: int) -> None:
        raise OSError(28, 'No space left on device')

    path = tmp_path / 'metrics.json'
    path.write_text('old')
    monkeypatch.setattr(os, 'fsync', full)
    with pytest.raises(FileError, match=r'metrics\.json: cannot be written: No space left'):
        write_bytes_atomically(path, b'new')
    assert path.read_text() == 'old'
    assert list(tmp_path.iterdir()) == [path]
