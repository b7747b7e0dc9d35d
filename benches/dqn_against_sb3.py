#!/usr/bin/env python3
"""Learns with many seeds here and with Stable-Baselines3, as `spikelane bench dqn` does with one.

    setup/bootstrap test; source setup/env.sh; benches/dqn_against_sb3.py OUT [SEEDS]

Prints the table of docs/results/dqn.md; about 2 minutes of a core for a seed. OUT, a folder, keeps
a file for each seed; what is there is not done again.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
import functools
import json
import multiprocessing
import os
from pathlib import Path
import statistics
import sys

import numpy as np
from scipy.stats import bootstrap, mannwhitneyu

from spikelane.report.quantities import COUNT, Quantity
from spikelane_benches.dqn import measure_dqn
from spikelane_sim.files import write_json

LANES = ('outer', 'inner')
SEEDS = 20


def main() -> None:
    """Learn what is not there yet, and print the table."""
    if len(sys.argv) not in (2, 3):
        sys.exit('usage: dqn_against_sb3.py OUT [SEEDS]')
    out = Path(sys.argv[1])
    out.mkdir(parents=True, exist_ok=True)
    seeds = range(int(sys.argv[2]) if len(sys.argv) > 2 else SEEDS)
    with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context('spawn')) as pool:
        list(pool.map(functools.partial(measure, out), seeds))
    results = [json.loads((out / f'{seed}.json').read_text('utf-8')) for seed in seeds]
    ratios = [result['ratio'] for result in results]
    print(f'{len(results)} seeds; processor time outside the environment, of theirs: ', end='')
    print(Quantity('.2f').median(ratios), end='\n\n')
    print_row('sum of rewards of a greedy episode', 'here', 'Stable-Baselines3')
    print_row(*['---'] * 3)
    for lane in LANES:
        both = [[result[f'{who}_{lane}'] for result in results] for who in ('ours', 'theirs')]
        print_row(f'{lane} lane: median (range)', *(COUNT.median(values) for values in both))
    ours, theirs = (
        np.array([sum(result[f'{who}_{lane}'] for lane in LANES) for result in results])
        for who in ('ours', 'theirs')
    )
    print_row(
        'both lanes: mean', f'{statistics.mean(ours):,.0f}', f'{statistics.mean(theirs):,.0f}'
    )
    difference = bootstrap(
        (ours, theirs),
        lambda a, b, axis: a.mean(axis) - b.mean(axis),
        method='percentile',
        rng=np.random.default_rng(0),
    ).confidence_interval
    better = mannwhitneyu(ours, theirs).statistic / len(ours) ** 2
    worse = mannwhitneyu(ours, theirs, alternative='less').pvalue
    print(
        f'\nDifference of the means, 95 % (bootstrap): {difference.low:+,.0f} to '
        f'{difference.high:+,.0f}. A policy from here has more than one of theirs in '
        f'{better:.0%} of pairs; that it has less in general: p = {worse:.2f} (Mann-Whitney).'
    )


def print_row(*cells: str) -> None:
    """Print a row of the table."""
    print(f'| {" | ".join(cells)} |')


def measure(out: Path, seed: int) -> None:
    """Learn with a seed, unless that was done."""
    file = out / f'{seed}.json'
    if not file.exists():
        write_json(file, measure_dqn(seed=seed))


if __name__ == '__main__':
    main()
