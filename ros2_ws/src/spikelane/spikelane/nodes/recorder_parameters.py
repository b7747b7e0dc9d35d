"""The parameters of the recorder."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from spikelane.bag.container import COMPRESSIONS
from spikelane.bag.writer import CHUNK_BYTES
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import parameter, Parameters


@dataclass(frozen=True, kw_only=True)
class RecorderParameters(Parameters):
    """What is recorded, and how."""

    output: str = parameter(
        '', 'Folder of the bag, which must not exist yet; empty: rosbag2_<date>-<time>.'
    )
    topics: tuple[str, ...] = parameter(
        (), 'Topics to record; none: all topics that are not hidden.'
    )
    exclude: tuple[str, ...] = parameter((), 'Topics that are not recorded.')
    needed: tuple[str, ...] = parameter(
        (),
        'Topics without which the bag is worthless: if one of them has no message, the bag is '
        'removed.',
    )
    compression: str = parameter('zstd', 'Compression of the chunks.', choices=COMPRESSIONS)
    chunk_bytes: int = parameter(
        CHUNK_BYTES,
        'Size at which a chunk is written to the file.',
        unit='B',
        low=1024,
        high=2**28,
    )
    max_file_bytes: int = parameter(
        0,
        'Size at which the next file is begun; 0: there is one file.',
        unit='B',
        low=0,
        high=2**62,
    )
    flush_period_s: float = parameter(
        1.0,
        'Time between two writes to the disk; a killed recorder loses at most the messages of '
        'this time, and `spikelane repair` makes its bag whole.',
        unit='s',
        low=0.05,
        high=60.0,
    )
    depth: int = parameter(
        10000, 'Number of messages of a topic that may wait to be recorded.', low=1, high=10**6
    )
    custom_data: tuple[str, ...] = parameter(
        (), 'Facts about the run that are kept in the metadata, as texts like seed=7.'
    )


def parse_facts(pairs: Iterable[str]) -> dict[str, str]:
    """Return the facts of `custom_data` by name.

    Raises:
        ParameterError: One of them is not like seed=7.
    """
    given = [pair for pair in pairs if pair]
    for pair in given:
        if '=' not in pair:
            raise ParameterError(f'custom_data: expected texts like seed=7, got {pair!r}')
    return dict(pair.split('=', 1) for pair in given)
