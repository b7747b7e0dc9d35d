"""What of the paper's figures, and of the runs, a report has nothing to show for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from spikelane.report.comparisons import (
    comparisons,
    MOST_COMPARISONS,
    MOST_OTHER_COURSES,
    Place,
    representative_laps,
)
from spikelane.report.groups import PAPER_LANE
from spikelane.report.runs import Lap, LeftOut, RANDOM_COURSES, Runs
from spikelane_controllers.registry import cards, title

NO_RUN = 'the folders that the report was given contain no such run'


def missing(runs: Runs) -> Iterator[LeftOut]:
    """Name the paper's figures that no run was there for."""
    trained = {(run.controller, run.scenario) for run in runs.trainings}
    driven = {(lap.controller, lap.scenario) for lap in runs.laps if lap.lane == PAPER_LANE}
    trained |= {(run.controller, run.scenario) for run in runs.transfers}
    shown = sorted(
        ((name, each, each.paper) for name, each in cards().items() if each.paper),
        key=lambda each: each[2].order,
    )
    for name, each, paper in shown:
        what = 'Transfer to {}' if each.transfer else '{} training'
        for scenario in paper.learnt:
            if (name, scenario) not in trained:
                words = f'{what.format(title(name))}, scenario {scenario}'
                yield LeftOut(words, NO_RUN)
        for scenario in paper.laps:
            if (name, scenario) not in driven:
                words = f'{title(name)} lap, scenario {scenario}, {PAPER_LANE} lane'
                yield LeftOut(words, NO_RUN)
    if runs.laps and not any(lap.metrics.get('operations') for lap in runs.laps):
        why = 'they are counted in laps driven in one process only, and no lap here was'
        yield LeftOut('Operations for a decision', why)
    yield from _not_compared(runs.laps)
    if not runs.laps:
        yield LeftOut('State input and animation of a lap', NO_RUN)


def _not_compared(laps: Sequence[Lap]) -> Iterator[LeftOut]:
    """Name the courses and settings that no comparison is drawn of."""
    chosen = representative_laps(laps)
    shown = {Place(key, each.lane) for each in comparisons(chosen) for key in each.keys}
    scenarios = {place.key.scenario for place in shown}
    others = list(dict.fromkeys(lap.scenario for lap in laps if lap.scenario not in scenarios))
    if RANDOM_COURSES in others:
        others.remove(RANDOM_COURSES)
        yield LeftOut(
            'Deviation on random courses',
            'each lap was driven on a different course, so that one figure cannot compare them',
        )
    if others:
        why = (
            f"the report draws at most {MOST_OTHER_COURSES} courses in addition to the paper's; "
            'the tables contain all'
        )
        yield LeftOut(f'Deviation on {", ".join(others)}', why)
    for place in chosen:
        if place not in shown and place.key.scenario in scenarios:
            why = (
                f'the report draws at most {MOST_COMPARISONS} figures for each scenario and lane; '
                'the tables contain all'
            )
            yield LeftOut(f'Deviation, {place.key.words}, {place.lane} lane', why)
