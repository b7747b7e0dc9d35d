"""A pixel's events pass that are not too soon after the one before."""

from spikelane_sim.events import make_events
from spikelane_sim.filters.refractory import REFRACTORY, RefractoryParameters

US = 1000


def test_an_event_passes_a_period_after_the_one_before_of_its_pixel() -> None:
    """Whether that one passed or not."""
    made = REFRACTORY.make(RefractoryParameters(period_s=0.001), 8, 8)
    t_us = [0, 400, 1200, 2200, 2201, 2300, 3199, 3200]
    x = [3, 3, 3, 3, 4, 3, 4, 3]
    events = make_events([t * US for t in t_us], x, 3, 1)
    expected = [True, False, False, True, True, False, False, False]
    assert made.passes(events[:3]).tolist() == expected[:3]
    assert made.passes(events[3:]).tolist() == expected[3:]
    made.reset()
    assert made.passes(events[:1]).tolist() == [True]
