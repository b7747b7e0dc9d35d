"""What docs/performance.md tells of the data that performance.py measures."""

from __future__ import annotations

from collections.abc import Callable
import re

import pandas as pd
from shared.tables import table_header, table_row

#: What a row is called, and what its times are of.
UNITS = {
    'fleet': ('{} robots, {} threads', 'robot-step'),
    'camera': ('{0} x {0} px', 'step'),
    'camera, anti-aliased': ('{0} x {0} px, anti-aliased', 'step'),
    'network': ('{} neurons x {} inputs', 'window of 50 ms'),
    'ray': ('8 trainings on {} workers of Ray', 'experiment'),
}


def table(rows: pd.DataFrame) -> str:
    """Return rows as a table."""
    times = ('processor time [µs]', 'range [µs]', 'wall time [µs]')
    lines = [table_header('size', 'of a', *times, 'memory [MB]')]
    for row in rows.itertuples():
        size, unit = UNITS[str(row.what)]
        is_here = row.what != 'ray'  # its work and its memory are in other processes
        low, high = row.processor_low_us, row.processor_high_us
        cells = [
            size.format(f'{row.size:,}', f'{row.other:,}'),
            unit,
            number(row.processor_us) if is_here else '',
            f'{number(low)} to {number(high)}' if is_here else '',
            number(row.wall_us),
            f'{row.memory_mb:,}' if is_here else '',
        ]
        lines.append(table_row(*cells))
    return '\n'.join(lines)


def number(value: float) -> str:
    """Return a number with three digits that count."""
    return f'{float(f"{value:.3g}"):,g}' if value < 1e6 else f'{round(value, -4):,.0f}'


def tell_machine(data: pd.DataFrame) -> str:
    """Return what it was measured on, and how much else that had to do."""
    low, high = data['load'].min(), data['load'].max()
    machines = ' and '.join(data['machine'].unique())
    processors = int(str(data['machine'].iloc[0]).split()[0])
    busy = (
        'The machine was busy with other work, so that wall times and what two threads gain say '
        'little, and processor times are longer than on a quiet one.'
        if high > 2 * processors
        else 'The machine had little else to do.'
    )
    return (
        'The numbers and tables of this page are from [the data](results/performance.csv). '
        f'Each size was measured {data["repeats"].max()} times (on Ray once), after one time that '
        f'does not count. Measured on {machines}, with a load average (of one '
        'minute, before each '
        f'measurement) of {low:.1f} to {high:.1f}. {busy}\n\n{FIGURE}'
    )


def tell_fleet(data: pd.DataFrame) -> str:
    """Return what a fleet costs."""
    rows = data[data['what'] == 'fleet'].set_index(['size', 'other'])
    first, last = rows.index[0][0], rows.index[-1][0]
    quickest = rows['wall_us'].idxmin()
    gains = [
        rows['wall_us'][size, 1] / rows['wall_us'][size, 2]
        for size in (64, 256)
        if (size, 2) in rows.index
    ]
    gain = ' and '.join(f'{each:.2f}' for each in gains)
    return (
        f'With {rows["count"].max():,} robot-steps in each measurement: a robot-step takes '
        f'{number(rows["processor_us"][first, 1])} µs of processor time with one robot and '
        f'{number(rows["processor_us"][last, 1])} µs with {last:,}. Most '
        f'robot-steps per second: {number(1e6 / rows["wall_us"][quickest])}, with '
        f'{quickest[0]:,} robots on {quickest[1]} threads. Two threads are {gain or "?"} times as '
        f'fast as one with 64 and 256 robots. A process with {last:,} robots takes '
        f'{rows["memory_mb"][last, 1]:,} MB, of which the libraries and one robot are '
        f'{rows["memory_mb"][first, 1]:,} MB.'
    )


def tell_camera(data: pd.DataFrame) -> str:
    """Return what a camera costs."""
    sentences = []
    for name, edges in (('camera', 'sharp edges'), ('camera, anti-aliased', 'anti-aliasing')):
        rows = data[data['what'] == name]
        first, last = rows.iloc[0], rows.iloc[-1]
        sentences.append(
            f'With {edges}, {(last["size"] / first["size"]) ** 2:,.0f} times as many pixels take '
            f'{last["processor_us"] / first["processor_us"]:.1f} times as long: '
            f'{number(first["processor_us"])} µs a step with {first["size"]} x {first["size"]} '
            f'and {number(last["processor_us"])} µs with {last["size"]} x {last["size"]}.'
        )
    return ' '.join(sentences)


def tell_network(data: pd.DataFrame) -> str:
    """Return what a network costs."""
    rows = data[data['what'] == 'network']
    paper, largest = rows.iloc[0], rows[rows['size'] * rows['other'] == 1_000_000]
    sentences = [
        f"50 ms of the paper's network, {paper['size']} neurons and {paper['other']} inputs, take "
        f'{number(paper["processor_us"])} µs, {number(50_000 / paper["processor_us"])} times as '
        'fast as real time.'
    ]
    for row in largest.itertuples():
        sentences.append(
            f'A million synapses, {row.size:,} neurons with {row.other:,} inputs each, take '
            f'{number(row.processor_us / 1000)} ms and {row.memory_mb:,} MB.'
        )
    return ' '.join(sentences)


def tell_ray(data: pd.DataFrame) -> str:
    """Return what an experiment on Ray takes."""
    walls = data[data['what'] == 'ray'].set_index('size')['wall_us'] / 1e6
    return (
        f'The eight trainings took {number(walls[1])} s on one worker and '
        f'{number(walls[2])} s on two ({walls[1] / walls[2]:.2f} times as fast), the start of Ray '
        'and of each process included.'
    )


FIGURE = (
    '![Robot-steps per second, memory, and the cost of cameras and networks]'
    '(results/performance.png)'
)

#: What is between the marks of the page, by their names.
BLOCKS: dict[str, Callable[[pd.DataFrame], str]] = {
    'machine': tell_machine,
    'fleet': lambda data: f'{tell_fleet(data)}\n\n{rows_of(data, "fleet")}',
    'camera': lambda data: (
        f'{tell_camera(data)}\n\n{rows_of(data, "camera", "camera, anti-aliased")}'
    ),
    'network': lambda data: f'{tell_network(data)}\n\n{rows_of(data, "network")}',
    'ray': tell_ray,
}


def rows_of(data: pd.DataFrame, *names: str) -> str:
    """Return the table of some things."""
    return table(data[data['what'].isin(names)])


def block(name: str, data: pd.DataFrame | None) -> str:
    """Return what is between two marks."""
    if data is None:
        return 'Not measured yet.'
    return re.sub(r'(?<![\d,])1 (robot|thread)s', r'1 \1', BLOCKS[name](data))


def fill(page: str, data: pd.DataFrame | None) -> str:
    """Return a page with what was measured between its marks.

    Args:
        page: The page.
        data: What was measured; None where nothing was.

    Raises:
        KeyError: The page has a mark of another name.
    """
    return re.sub(
        r'<!-- measured: (\w+) -->\n.*?<!-- end -->',
        lambda mark: f'<!-- measured: {mark[1]} -->\n{block(mark[1], data)}\n<!-- end -->',
        page,
        flags=re.DOTALL,
    )
