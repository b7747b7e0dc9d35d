"""A recorded drive: event packets in order, each with its lane state and its recorded answer.

A packet belongs to a lane state and to wheel velocities by their stamps; where simulation time
was reset and a stamp comes again, to those recorded next to it. Packets are put in the order of
their numbers, and one that was sent twice counts once. Where a camera's driver was started again,
numbers far below those before, its packets come after those of the time before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import contextlib
import itertools
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

from spikelane.bag.changes import PARAMETER_EVENT, read_changes, RecordedChanges
from spikelane.bag.foreign import legacy_hint
from spikelane.bag.source import BagSource, Faults, SourceMessage
from spikelane_sim import topic_names
from spikelane_sim.codecs import DECODABLE
from spikelane_sim.contract import LaneState, WheelEncoders, WheelVelocities
from spikelane_sim.errors import BagError, MessageError
from spikelane_sim.messages import (
    encoders_from_message,
    lane_state_from_message,
    received_packet,
    to_stamp_ns,
    wheels_from_message,
)
from spikelane_sim.sensor import ReceivedPacket

EVENT_PACKET = 'event_camera_msgs/msg/EventPacket'
OLD_EVENT_PACKET = 'event_array_msgs/msg/EventArray'  # its name until 2023, with the same fields
LANE_STATE = 'spikelane_msgs/msg/LaneState'
WHEEL_VELOCITIES = 'spikelane_msgs/msg/WheelVelocities'
_CONTROLLER_STATE = 'spikelane_msgs/msg/ControllerState'
JOINT_STATE = 'sensor_msgs/msg/JointState'
EVENT_TYPES = (EVENT_PACKET, OLD_EVENT_PACKET)
TYPES = (*EVENT_TYPES, LANE_STATE, WHEEL_VELOCITIES, JOINT_STATE)


#: Packets overtake each other by less; a number further back is of a driver started again.
_OVERTAKEN = 100
#: Drivers are not started again more often in one recording.
_RESTARTS = 10
#: After so many messages that cannot be read no more are tried.
_UNREADABLE = 100_000
_NAMED = 12  # topics in a message at most

T = TypeVar('T')


class DrivePacket(NamedTuple):
    """An event packet with the messages that were recorded with it."""

    packet: ReceivedPacket
    lane: LaneState | None
    log_ns: int  # when it was recorded
    position: int  # in the bag, counting messages of TYPES
    encoders: WheelEncoders | None = None


class _Mark(NamedTuple):
    """Where a packet is in the bag."""

    sequence: int
    stamp_ns: int
    log_ns: int
    position: int


class _Logged(NamedTuple, Generic[T]):
    """What a message says, and where it is in the bag."""

    value: T
    log_ns: int
    position: int


class _Record(NamedTuple):
    """What a message says."""

    stamp_ns: int
    value: ReceivedPacket | LaneState | WheelVelocities | WheelEncoders | None


class _Read(NamedTuple):
    """A message read."""

    position: int
    message: SourceMessage
    record: _Record


class RecordedDrive:
    """The events, lane states and wheel velocities of a bag.

    Event packets are read from the bag as they are asked for, unless they are out of order.

    Attributes:
        source: The bag.
        events_topic: Where the events are from.
        has_lane: Whether there are lane states.
        has_wheels: Whether there are wheel velocities.
        has_encoders: Whether there are joint states of the wheels.
        count: Event packets.
        changes: What was changed of the nodes' parameters.
        notes: What is missing, damaged or out of order, a sentence each.
    """

    def __init__(self, path: Path, events_topic: str | None = None) -> None:
        """Read all but the events.

        Args:
            path: A bag's folder, or one of its files.
            events_topic: Where to take the events from; None for the usual topic, or for the one
                there is.

        Raises:
            BagError: There is no bag, it has no event packets, or those of several cameras, or in
                an encoding that cannot be decoded.
        """
        self.source = BagSource(path)
        self.notes: list[str] = list(self.source.notes)
        self._damage: list[str] = []
        marks: dict[str, list[_Mark]] = {}
        encodings: dict[str, str] = {}
        lanes: dict[str, dict[int, list[_Logged[LaneState]]]] = {}
        wheels: dict[str, dict[int, list[_Logged[WheelVelocities]]]] = {}
        joints: dict[str, dict[int, list[_Logged[WheelEncoders]]]] = {}
        for position, message, record in self._read():
            stamp_ns, topic = record.stamp_ns, message.topic
            where = message.log_ns, position
            if isinstance(record.value, ReceivedPacket):
                mark = _Mark(record.value.sequence, stamp_ns, *where)
                marks.setdefault(topic, []).append(mark)
                encodings.setdefault(topic, record.value.encoding)
            elif isinstance(record.value, LaneState):
                of_stamp = lanes.setdefault(topic, {}).setdefault(stamp_ns, [])
                of_stamp.append(_Logged(record.value, *where))
            elif isinstance(record.value, WheelEncoders):
                measured = joints.setdefault(topic, {}).setdefault(stamp_ns, [])
                measured.append(_Logged(record.value, *where))
            elif record.value is not None:  # joints of something else
                answers = wheels.setdefault(topic, {}).setdefault(stamp_ns, [])
                answers.append(_Logged(record.value, *where))
        self.events_topic = self._choose(events_topic, marks)
        encoding = encodings[self.events_topic]
        if encoding not in DECODABLE:
            raise BagError(
                f'{path}: {self.events_topic}: expected events encoded as one of '
                f'{", ".join(DECODABLE)}, got {encoding!r}'
            )
        prefix = self.events_topic.removesuffix(topic_names.EVENTS)
        prefix = prefix if prefix != self.events_topic else '/'
        self._lanes = lanes.get(prefix + topic_names.LANE_STATE, {})
        self._wheels = wheels.get(prefix + topic_names.WHEELS, {})
        self._encoders = joints.get(prefix + topic_names.JOINT_STATES, {})
        self.has_lane, self.has_wheels = bool(self._lanes), bool(self._wheels)
        self.has_encoders = bool(self._encoders)
        self._note_what_is_missing(prefix)
        self.changes = RecordedChanges((), ())
        if PARAMETER_EVENT in self.source.topics.values():
            self._read_changes(prefix)
        found = marks[self.events_topic]
        self._refuse_several_publishers(found)
        self._order = _in_order(found)
        self.count = len(self._order)
        positions = [mark.position for mark in self._order]
        self._is_in_order = positions == sorted(positions)
        if not self._is_in_order:
            self.notes.append('the event packets were out of order; taken by their numbers')
        self._note_lost()

    @property
    def controller(self) -> str | None:
        """The controller that drove: by the bag's facts, else by its first state message."""
        if said := self.source.custom_data.get('controller'):
            return said
        if _CONTROLLER_STATE not in self.source.topics.values():
            return None
        for message in self.source.messages((_CONTROLLER_STATE,)):
            with contextlib.suppress(BagError, AttributeError):
                return str(self.source.read(message).controller)
        return None

    @property
    def period_ms(self) -> int | None:
        """Control period of what drove, as the lane states tell; None where they tell none."""
        stamps_ns = {
            (each.value.episode, each.value.step): stamp_ns
            for stamp_ns, logged in self._lanes.items()
            for each in logged
        }
        for (episode, step), stamp_ns in stamps_ns.items():
            after_ns = stamps_ns.get((episode, step + 1), 0)
            if after_ns > stamp_ns:
                return round((after_ns - stamp_ns) / 1e6)
        return None

    def packets(self) -> Iterator[DrivePacket]:
        """Yield the event packets in order."""
        wanted = {mark.position for mark in self._order}
        found = (
            self._with_nearest(position, message, record.value)
            for position, message, record in self._read(wanted)
            if isinstance(record.value, ReceivedPacket)
        )
        if self._is_in_order:
            yield from found
            return
        by_position = {each.position: each for each in found}
        for mark in self._order:
            yield by_position[mark.position]

    def answer(self, stamp_ns: int, packet: DrivePacket) -> WheelVelocities | None:
        """Return the recorded wheel velocities of this stamp, None where there are none."""
        return _nearest(self._wheels, stamp_ns, packet.log_ns, packet.position)

    def _read(self, wanted: set[int] | None = None) -> Iterator[_Read]:
        """Yield positions, messages and what they say; of all messages, or of those wanted."""
        faults = Faults()
        for position, message in enumerate(self.source.messages(TYPES)):
            if wanted is not None and position not in wanted:
                continue
            try:
                yield _Read(position, message, self._record(message))
            except BagError as error:
                faults.add(message.topic, str(error).removeprefix(f'{self.source.path}: '))
                if faults.count > _UNREADABLE:  # in hours there would be nothing else
                    break
        if wanted is None:
            self._damage = [*self.source.damage, *faults.notes('messages cannot be read')]
            if faults.count > _UNREADABLE:
                self._damage.append(f'no more was read after {faults.count} such messages')
            self.notes += self._damage
            if self.source.is_cut:
                self.notes.append('`spikelane repair` makes such a bag whole for other programs')

    def _record(self, message: SourceMessage) -> _Record:
        fields = self.source.read(message)
        try:
            return _Record(
                to_stamp_ns(fields.header.stamp), _CONVERSIONS[message.type_name](fields)
            )
        except MessageError as error:
            raise BagError(f'{self.source.path}: {message.topic}: {error}') from None
        except AttributeError as error:  # of a definition that is not ours
            raise BagError(
                f'{self.source.path}: {message.topic}: expected the fields of '
                f'{message.type_name}, got others: {error}'
            ) from None

    def _choose(self, asked: str | None, marks: Mapping[str, Sequence[_Mark]]) -> str:
        usual = asked or f'/{topic_names.EVENTS}'
        if usual in marks:
            return usual
        if asked is None and len(marks) == 1:
            return next(iter(marks))
        expected = asked or f'one topic of {EVENT_PACKET}'
        found = ', '.join(sorted(marks)) or self._other_topics()
        raise BagError(f'{self.source.path}: expected {expected} with messages, got {found}')

    def _other_topics(self) -> str:
        """Return what there is instead of event packets, and what could not be read."""
        types = self.source.topics
        empty = [topic for topic in sorted(types) if types[topic] in EVENT_TYPES]
        named = [f'{topic} ({types[topic] or "of no type"})' for topic in sorted(types)]
        if len(named) > _NAMED:
            named[_NAMED:] = [f'{len(named) - _NAMED} more']
        found = f'none, only {", ".join(named)}' if named else 'none, and no other topics'
        if empty:
            found = f'{", ".join(empty)} without a readable message'
        damage = '; '.join(self._damage)
        return found + legacy_hint(frozenset(types.values())) + (f' ({damage})' if damage else '')

    def _refuse_several_publishers(self, marks: Sequence[_Mark]) -> None:
        """Raise where several publishers' packets take turns, each with numbers of its own.

        Raises:
            BagError: They do.
        """
        once = list({(mark.sequence, mark.stamp_ns): mark for mark in marks}.values())
        if len({mark.sequence for mark in once}) == 1:
            return  # a publisher that does not count
        back = sum(
            after.sequence <= before.sequence and after.log_ns > before.log_ns
            for before, after in itertools.pairwise(once)
        )
        if back > max(_RESTARTS, len(once) // 50):
            raise BagError(
                f'{self.source.path}: {self.events_topic}: expected the packets of one publisher, '
                f'got alternating packets of several publishers: their numbers go back '
                f'{back} times in {len(once)} packets'
            )

    def _note_what_is_missing(self, prefix: str) -> None:
        if not self.has_lane:
            self.notes.append(
                f'no {prefix}{topic_names.LANE_STATE}: one episode, distances unknown'
            )
        if not self.has_wheels:
            self.notes.append(f'no {prefix}{topic_names.WHEELS}: nothing to compare with')

    def _note_lost(self) -> None:
        pairs = zip(self._order, self._order[1:], strict=False)
        gaps = [
            (before.stamp_ns, after.sequence - before.sequence - 1)
            for before, after in pairs
            if after.sequence > before.sequence + 1
        ]
        if gaps:
            lost = sum(count for _, count in gaps)
            self.notes.append(
                f'{lost} event packets are missing, the first after stamp {gaps[0][0]} ns: '
                'answers after a gap may differ'
            )
        if self.has_lane:
            bare = sum(mark.stamp_ns not in self._lanes for mark in self._order)
            if bare:
                self.notes.append(f'{bare} event packets lack their lane state')
            seen = {mark.stamp_ns for mark in self._order}
            alone = sum(stamp_ns not in seen for stamp_ns in self._lanes)
            if alone:
                self.notes.append(f'{alone} lane states lack their event packet')

    def _read_changes(self, prefix: str) -> None:
        try:
            self.changes = read_changes(self.source, prefix)
        except BagError as error:
            self.notes.append(f'changes of parameters are unknown: {error}')
        self.notes += self.changes.notes()

    def _with_nearest(
        self, position: int, message: SourceMessage, packet: ReceivedPacket
    ) -> DrivePacket:
        lane = _nearest(self._lanes, packet.stamp_ns, message.log_ns, position)
        encoders = _nearest(self._encoders, packet.stamp_ns, message.log_ns, position)
        return DrivePacket(packet, lane, message.log_ns, position, encoders)


def _in_order(marks: Sequence[_Mark]) -> list[_Mark]:
    """Return packets once each, session by session."""
    once: dict[tuple[int, int], _Mark] = {}
    for mark in marks:
        once.setdefault((mark.sequence, mark.stamp_ns), mark)
    found = list(once.values())
    begins = [
        number
        for number, (before, after) in enumerate(itertools.pairwise(found), 1)
        if after.sequence < before.sequence - _OVERTAKEN and after.log_ns > before.log_ns
    ]
    limits = zip([0, *begins], [*begins, len(found)], strict=True)
    return [mark for begin, end in limits for mark in _by_number(found[begin:end])]


def _by_number(session: list[_Mark]) -> list[_Mark]:
    """Return packets by their numbers where these tell them apart."""
    if len({mark.sequence for mark in session}) < len(session):
        return session  # a publisher that began anew, or does not count
    return sorted(session, key=lambda mark: mark.sequence)


def _nearest(
    found: Mapping[int, Sequence[_Logged[T]]], stamp_ns: int, log_ns: int, position: int
) -> T | None:
    """Return what was recorded next to a place, of all that have a stamp."""
    candidates = found.get(stamp_ns)
    if not candidates:
        return None
    nearest = min(
        candidates, key=lambda each: (abs(each.log_ns - log_ns), abs(each.position - position))
    )
    return nearest.value


_CONVERSIONS: Mapping[
    str, Callable[[Any], ReceivedPacket | LaneState | WheelVelocities | WheelEncoders | None]
] = {
    EVENT_PACKET: received_packet,
    OLD_EVENT_PACKET: received_packet,
    LANE_STATE: lane_state_from_message,
    WHEEL_VELOCITIES: wheels_from_message,
    JOINT_STATE: encoders_from_message,
}
