"""The store of states: what goes in comes out, compressed, whatever a kill left behind."""

from __future__ import annotations

import io
from pathlib import Path
import struct

import numpy as np
import pytest
import zstandard

from spikelane_controllers.dqn.visited_states import read_states, StateStore
from spikelane_sim.errors import CheckpointError

SHAPE = (16, 32)


def states_of(count: int, seed: int = 0) -> np.ndarray:
    """Return sparse counts, some beyond what a byte holds."""
    rng = np.random.default_rng(seed)
    return rng.integers(1, 300, (count, *SHAPE)) * (rng.random((count, *SHAPE)) < 0.05)


def write(path: Path, states: np.ndarray, every: int) -> StateStore:
    """Write states, flushed every so many."""
    store = StateStore(path, SHAPE)
    store.begin()
    for index, state in enumerate(states, 1):
        store.append(state)
        if index % every == 0:
            store.flush()
    return store


def test_states_come_back_in_order_and_saturated(tmp_path: Path) -> None:
    """Those flushed; by the file or by its folder."""
    states = states_of(25)
    write(tmp_path / 'states.zst', states, 10)
    for path in (tmp_path, tmp_path / 'states.zst'):
        got = read_states(path)
        assert got.dtype == np.uint8
        assert got.tolist() == states[:20].clip(max=255).tolist()
    assert states.max() > 255


def test_nothing_added_is_no_state(tmp_path: Path) -> None:
    """Flushing it writes nothing."""
    store = write(tmp_path / 'states.zst', states_of(0), 1)
    before = (tmp_path / 'states.zst').read_bytes()
    store.flush()
    assert (tmp_path / 'states.zst').read_bytes() == before
    assert read_states(tmp_path).shape == (0, 16, 32)


def test_any_zstd_program_unpacks_it(tmp_path: Path) -> None:
    """To the counts, a byte each."""
    states = states_of(20).clip(max=255)
    write(tmp_path / 'states.zst', states, 5)
    packed = (tmp_path / 'states.zst').read_bytes()
    with zstandard.ZstdDecompressor().stream_reader(
        io.BytesIO(packed), read_across_frames=True
    ) as reader:
        unpacked = reader.read()
    assert unpacked == states.astype(np.uint8).tobytes()
    assert len(packed) < len(unpacked) / 4


def test_a_store_goes_on_from_what_a_checkpoint_knows(tmp_path: Path) -> None:
    """What was written after it, whole or cut off, is dropped: the file is as if never stopped."""
    states = states_of(30)
    write(tmp_path / 'whole.zst', states, 10)
    path = tmp_path / 'killed.zst'
    write(path, states_of(20, seed=1), 10)
    write(path, states[:20], 10)
    with path.open('ab') as file:
        file.write(path.read_bytes()[-40:-20])
    store = StateStore(path, SHAPE)
    store.resume(10)
    for state in states[10:]:
        store.append(state)
        if (state == states[19]).all():
            store.flush()
    store.flush()
    assert path.read_bytes() == (tmp_path / 'whole.zst').read_bytes()


@pytest.mark.parametrize('states', [5, 21])
def test_a_store_without_the_states_a_checkpoint_needs_is_refused(
    tmp_path: Path, states: int
) -> None:
    """Too few, or not written together; the file stays as it is."""
    path = tmp_path / 'states.zst'
    write(path, states_of(20), 10)
    before = path.read_bytes()
    with pytest.raises(CheckpointError, match=f'{path}: expected {states} states, got [12]0'):
        StateStore(path, SHAPE).resume(states)
    assert path.read_bytes() == before


def test_another_shape_is_refused(tmp_path: Path) -> None:
    """A resumed training has other cells."""
    write(tmp_path / 'states.zst', states_of(1), 1)
    with pytest.raises(CheckpointError, match=r'expected states of \(8, 4\), got \(16, 32\)'):
        StateStore(tmp_path / 'states.zst', (8, 4)).resume(1)


def test_what_is_no_whole_file_of_states_is_refused(tmp_path: Path) -> None:
    """Nothing, another file, an older version, a truncated file and a damaged one."""
    path = tmp_path / 'states.zst'

    def message() -> str:
        with pytest.raises(CheckpointError) as caught:
            read_states(path)
        return str(caught.value)

    assert message() == f'{path}: expected the states of a training, got none: ' + (
        'No such file or directory'
    )
    path.write_bytes(b'RIFF' + bytes(40))
    assert message() == f'{path}: expected the states of a training, got another file'
    head = b'{"format": "spikelane-states", "version": 2}'
    path.write_bytes(struct.pack('<II', 0x184D2A50, len(head)) + head)
    assert message() == f'{path}: expected version 1, got 2'
    write(path, states_of(20), 10)
    content = path.read_bytes()
    for end in (len(content) - 1, len(content) - 200):
        path.write_bytes(content[:end])
        assert message() == f'{path}: expected a whole file, got one truncated'
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    assert 'cannot be unpacked' in message()
