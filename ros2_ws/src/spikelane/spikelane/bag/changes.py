"""Changes of parameters during a drive, as its recording tells of them.

A node that lets parameters change publishes each change with the stamp of the first observation
that it holds for. The facts in a bag's metadata are those of the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from spikelane.bag.source import BagSource, SourceMessage
from spikelane_sim import topic_names
from spikelane_sim.errors import BagError, MessageError
from spikelane_sim.messages import change_from_message
from spikelane_sim.parameter_changes import ParameterChange

PARAMETER_EVENT = 'rcl_interfaces/msg/ParameterEvent'
_NAMED = 6  # changes in a note at most


class RecordedChange(NamedTuple):
    """A change and when it was recorded."""

    node: str  # full name
    change: ParameterChange
    log_ns: int

    def __str__(self) -> str:
        """Say what was changed, and when."""
        values = ', '.join(f'{name} = {value}' for name, value in self.change.values.items())
        return f'{values} from {self.change.stamp_ns / 1e9:g} s on'


class RecordedChanges(NamedTuple):
    """The changes of a drive, in the order of recording."""

    simulator: Sequence[RecordedChange]
    controller: Sequence[RecordedChange]

    def notes(self) -> list[str]:
        """Return a sentence on each node whose parameters were changed."""
        found = []
        for changes in self:
            if changes:
                named = [str(each) for each in changes[:_NAMED]]
                if len(changes) > _NAMED:
                    named.append(f'{len(changes) - _NAMED} more changes')
                node = changes[0].node
                found.append(f'parameters of {node} were changed in the drive: {"; ".join(named)}')
        return found


def read_changes(source: BagSource, prefix: str = '/') -> RecordedChanges:
    """Read the changes of a drive from a bag.

    Args:
        source: The bag.
        prefix: Namespace of the drive, with a slash at its end.

    Raises:
        BagError: A message cannot be read.
    """
    topics = [
        prefix + each for each in (topic_names.SIMULATOR_CHANGES, topic_names.CONTROLLER_CHANGES)
    ]
    found: dict[str, list[RecordedChange]] = {topic: [] for topic in topics}
    for message in source.messages((PARAMETER_EVENT,)):
        if message.topic in found:
            found[message.topic].append(_read(source, message))
    return RecordedChanges(*found.values())


def _read(source: BagSource, message: SourceMessage) -> RecordedChange:
    fields = source.read(message)
    try:
        change = change_from_message(fields)
    except (MessageError, AttributeError) as error:
        raise BagError(f'{source.path}: {message.topic}: {error}') from None
    return RecordedChange(str(fields.node), change, message.log_ns)
