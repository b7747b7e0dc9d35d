"""How the laps of an evaluation went on the whole, in numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from spikelane.runs.evaluate.config import EvaluateConfig
from spikelane.runs.evaluate.summary import summarise, summarise_by_lane
from spikelane.statistics import METHOD, share_statistics
from spikelane_controllers.operations import Operations, operations_metrics, sum_operations


def evaluation_metrics(config: EvaluateConfig, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Measure an evaluation.

    Args:
        config: What was driven.
        rows: One row for each lap: its course, lane and seed, what `lap_metrics` says,
            progress_m, and operations, the fields of `Operations` or None.

    Returns:
        Facts of the configuration; `operations`: what the network had to compute, as
        `operations_metrics` has it, None where it was not counted; `confidence`: how intervals
        are found; `summary`: of `all` laps, `by_lane` and, where there are several, `by_course`,
        as `summary.summarise` has it (the weights are those of one training, so that the unit is
        the course, or the seed where there is one course); then also `courses_completed`: on how
        many courses all laps were; `laps`: the rows.
    """
    courses = list(dict.fromkeys(row['course'] for row in rows))
    summary = summarise_by_lane(rows)
    if len(courses) > 1:
        summary['by_course'] = {
            course: summarise([row for row in rows if row['course'] == course])
            for course in courses
        }
        completed = [group['completed'] for group in summary['by_course'].values()]
        summary['courses_completed'] = share_statistics(
            sum(each['successes'] == each['n'] for each in completed), len(completed)
        )
    link = config.simulator.link
    return {
        **config.facts(),
        'seeds': config.evaluation.seeds,
        'latency_ms': link.latency_ms,
        'event_loss': link.event_loss,
        'confidence': METHOD,
        'operations': _operations(rows, config.simulator.period_s),
        'summary': summary,
        'laps': list(rows),
    }


def _operations(rows: Sequence[Mapping[str, Any]], period_s: float) -> dict[str, Any] | None:
    """Describe what the network had to compute in all laps, None where one's is not known."""
    counted = [Operations(**row['operations']) for row in rows if row.get('operations')]
    if len(counted) < len(rows):
        return None
    # Every observation counts, the one at the reset included.
    observations = sum(row['steps'] + 1 for row in rows)
    return operations_metrics(sum_operations(counted), observations * period_s)
