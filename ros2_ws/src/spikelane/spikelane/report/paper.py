"""Where the paper's numbers are: on the controllers' cards.

Bing et al. (2020), Neural Networks 121. Its figures give most errors as curves only; what is on
the cards is written in its text, tables and captions.
"""

from __future__ import annotations

from spikelane_controllers.card import PaperValue
from spikelane_controllers.registry import cards

PAPER_SCENARIOS = ('1', '2', '3')


def paper_value(controller: str, scenario: str, measure: str) -> PaperValue | None:
    """Return what the paper says of a measure, None where it says nothing."""
    found = cards().get(controller)
    return found.paper.value(scenario, measure) if found and found.paper else None
