"""A recorder that loses messages: losing_recorder.py WHERE TOPIC,... --ros-args ...

WHERE is 'arrival' for messages that do not reach it, and 'bag' for those that it has counted as
written but does not write.
"""

import sys
from typing import Any

from spikelane.bag.writer import BagWriter
from spikelane.nodes import recorder
from spikelane.nodes.recorded_topics import RecordedTopics

EVERY = 40  # one message of so many is lost, of each topic


def main() -> int:
    """Record."""
    where, names = sys.argv.pop(1), sys.argv.pop(1).split(',')
    seen: dict[Any, int] = {}

    def is_lost(key: Any) -> bool:
        seen[key] = seen.get(key, 0) + 1
        return seen[key] % EVERY == 0

    if where == 'arrival':
        take = RecordedTopics.take

        def take_most(self: RecordedTopics) -> list[Any]:
            lossy = {self.ids[name] for name in names if name in self.ids}
            return [each for each in take(self) if each[1] not in lossy or not is_lost(each[1])]

        RecordedTopics.take = take_most  # type: ignore[method-assign]
    else:
        add, write = BagWriter.add_topic, BagWriter.write
        lossy: set[int] = set()

        def add_topic(self: BagWriter, name: str, *others: Any) -> int:
            number = add(self, name, *others)
            lossy.update({number} if name in names else ())
            return number

        def write_most(self: BagWriter, topic: int, *others: Any) -> None:
            if topic not in lossy or not is_lost(topic):
                write(self, topic, *others)

        BagWriter.add_topic = add_topic  # type: ignore[method-assign]
        BagWriter.write = write_most  # type: ignore[method-assign]
    return recorder.main()


if __name__ == '__main__':
    sys.exit(main())
