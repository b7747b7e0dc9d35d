"""Experiments on filters: their parameters are those of runs, and results tell them apart."""

from pathlib import Path

from spikelane.experiment.file import read_experiment
from spikelane.experiment.plan import make_plan

ROOT = Path(__file__).parents[4]


def test_the_experiment_on_filters_has_each_rate_with_each_filter() -> None:
    """Each camera has four filters and none, except one that the paper's camera lacks."""
    plan = make_plan(read_experiment(ROOT / 'experiments/filters.yaml'))
    found: dict[tuple[str, str], list[float]] = {}
    for run in plan.runs:
        configuration = run.identity['configuration']
        simulator, filters = configuration['simulator'], configuration.get('filter', {})
        rate = simulator['pixels.coppelia.noise_rate_hz'] or simulator['pixels.esim.shot_rate_hz']
        supporters = filters.get('correlation.supporters')
        chain = filters.get('chain', '')
        name = f'{chain} {supporters}' if chain == 'correlation' else chain
        found.setdefault((simulator['pixels.model'], name), []).append(rate)
    rates = [0.1, 0.3, 1.0, 3.0, 10.0]
    names = ['', 'refractory', 'nearest_neighbour', 'correlation 2']
    assert found == {
        **{('coppelia', name): rates for name in names},
        **{('esim', name): rates for name in [*names, 'correlation 3']},
    }
