"""Order, time and loss: what a recorder does between receiving messages and writing them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from operator import itemgetter
import struct

from spikelane.bag.writer import BagWriter

# When it was received [ns], topic id, when it was sent [ns], the publisher's count, the message.
Arrival = tuple[int, int, int, int, bytes]
# The topic id of arrivals that are looked at, but not written.
NOT_RECORDED = 0
_CLOCK = struct.Struct('<4xiI')


class Recording:
    """Writes batches of arrivals, each in the order of reception."""

    def __init__(self, writer: BagWriter, *, use_sim_time: bool = False) -> None:
        """Record into the writer.

        Args:
            writer: Takes the messages; closed by its owner.
            use_sim_time: Stamp messages with the last /clock message received before them
                instead of the time of reception. Those before the first wait for it.
        """
        self._writer = writer
        self._use_sim_time = use_sim_time
        self._clock_topic: int | None = None
        self._clock_ns: int | None = None
        self._early: list[Arrival] = []
        self._watched: dict[int, int | None] = {}
        self._first: dict[int, int] = {}  # number of the first message of a watched topic
        self._lacking: Counter[int] = Counter()
        self._gaps: Counter[int] = Counter()
        self._reported: Counter[int] = Counter()

    def follow_clock(self, topic_id: int) -> None:
        """Take the messages of this topic (or of NOT_RECORDED) for /clock.

        When it goes back, a new episode begins, and latched messages are repeated.
        """
        self._clock_topic = topic_id

    def watch_losses(self, topic_id: int, *, has_one_publisher: bool) -> None:
        """Count the gaps in a topic's numbering; with several publishers there is none."""
        if has_one_publisher:
            self._watched.setdefault(topic_id, None)
        else:
            self._watched.pop(topic_id, None)
            # Those of the first moments, when nobody knew of the second publisher.
            self._gaps.pop(topic_id, None)

    def compare(self, topic_id: int, first: int, last: int) -> None:
        """Compare what was written of a watched topic with what its publisher sent.

        Args:
            topic_id: The topic.
            first: Number of the first message that was to be recorded.
            last: Number of the last message sent.
        """
        written = self._watched.get(topic_id)
        if topic_id not in self._watched:
            return  # of several publishers, each of which counts for itself
        if written is None:
            self._lacking[topic_id] = max(last - first + 1, 0)
        else:
            head, tail = self._first[topic_id] - first, last - written
            self._lacking[topic_id] = max(head, 0) + max(tail, 0)

    def report_lost(self, topic_id: int, count: int) -> None:
        """Take how many messages of a topic the middleware has counted as lost in all."""
        if topic_id != NOT_RECORDED:
            self._reported[topic_id] = count

    @property
    def lost(self) -> Mapping[int, int]:
        """Messages that were sent and did not arrive, by topic; topics without any are left out.

        The numbering tells also what came and was dropped before it was taken, the middleware also
        what several publishers sent, and the publishers what is lacking at either end.
        """
        return +((self._gaps + self._lacking) | self._reported)

    @property
    def lost_count(self) -> int:
        """Messages of all topics that were sent and did not arrive."""
        return sum(self.lost.values())

    @property
    def written_count(self) -> int:
        """Messages written, those repeated for late readers included."""
        return self._writer.message_count

    @property
    def last_numbers(self) -> dict[int, int]:
        """Number of the last message of each watched topic, as its publisher counts from 1.

        0 where none has arrived.
        """
        return {topic_id: number or 0 for topic_id, number in self._watched.items()}

    def write(self, arrivals: Sequence[Arrival]) -> None:
        """Write a batch.

        Raises:
            BagError: The disk is full.
        """
        for arrival in sorted(arrivals, key=itemgetter(0)):
            received_ns, topic_id, source_ns, sequence, data = arrival
            if topic_id in self._watched:
                self._count_losses(topic_id, sequence)
            if topic_id == self._clock_topic:
                self._set_clock(data, received_ns)
            if not self._use_sim_time:
                if topic_id != NOT_RECORDED:
                    self._writer.write(topic_id, received_ns, source_ns, data)
            elif self._clock_ns is None:
                self._early.append(arrival)
            elif topic_id != NOT_RECORDED:
                self._writer.write(topic_id, self._clock_ns, source_ns, data)

    def end(self) -> None:
        """Write what was still waiting for a clock, with its time of reception.

        Raises:
            BagError: The disk is full.
        """
        self._use_sim_time = False
        early, self._early = self._early, []
        self.write(early)

    def _count_losses(self, topic_id: int, sequence: int) -> None:
        last = self._watched[topic_id]
        if last is None:
            self._first[topic_id] = sequence
        if last is not None and sequence > last + 1:
            self._gaps[topic_id] += sequence - last - 1
        self._watched[topic_id] = sequence

    def _set_clock(self, data: bytes, received_ns: int) -> None:
        if len(data) < _CLOCK.size:
            return
        sec, nanosec = _CLOCK.unpack_from(data)
        before_ns, self._clock_ns = self._clock_ns, max(sec * 10**9 + nanosec, 0)
        log_ns = self._clock_ns if self._use_sim_time else received_ns
        if before_ns is None:
            early, self._early = self._early, []
            for _, topic_id, source_ns, _, message in early:
                if topic_id != NOT_RECORDED:
                    self._writer.write(topic_id, log_ns, source_ns, message)
        elif self._clock_ns < before_ns:
            self._writer.repeat_latched(log_ns)
