"""The trajectory of an episode, read from a recording of the graph."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
import functools
from pathlib import Path
from typing import Any, NamedTuple

from spikelane.runs.lap.step_messages import LaneStates, StepMessages
from spikelane.runs.lap.trajectory import Trajectory, TrajectoryError
from spikelane_sim import topic_names
from spikelane_sim.errors import BagError, MessageError, PacketError
from spikelane_sim.events import Events
from spikelane_sim.messages import lane_state_from_message, to_stamp_ns, wheels_from_message

LANE_STATE = f'/{topic_names.LANE_STATE}'
ODOMETRY = f'/{topic_names.ODOMETRY}'
WHEELS = f'/{topic_names.WHEELS}'
EVENTS = f'/{topic_names.EVENTS}'


class Recorded(NamedTuple):
    """A message and when it was recorded."""

    topic: str
    log_ns: int
    stamp_ns: int  # from its header
    message: Any


def read_trajectory(bag: Path, episode: int | None = None) -> Trajectory:
    """Read one episode from a recording.

    The messages of a step carry one stamp and are put together by it. Where simulation time was
    reset and a stamp comes again, the message recorded next to the lane state is meant.

    Args:
        bag: Folder of a rosbag2 recording, or its one .mcap file.
        episode: Its number in the lane states, the last one with it where a new seed made the
            numbers begin again; None where just one was driven. One that was reset and not
            driven is passed over.

    Raises:
        BagError: The recording cannot be read, or lacks a topic, the episode, or a message
            between others.
    """
    try:
        steps = StepMessages(_choose_episode(bag, read_messages(bag, [LANE_STATE]), episode))
        for recorded in read_messages(bag, [ODOMETRY, WHEELS, EVENTS]):
            kind, values_of = _KINDS[recorded.topic]
            steps.add(
                kind,
                recorded.stamp_ns,
                recorded.log_ns,
                functools.partial(values_of, recorded.message),
            )
        return steps.trajectory()
    except (TrajectoryError, PacketError, MessageError) as error:
        raise BagError(f'{bag}: {error}') from None


def read_messages(bag: Path, topics: Sequence[str]) -> Iterator[Recorded]:
    """Yield the messages on these topics in the order they were recorded.

    What a broken file does inside the reader's libraries is not ours to list, so that whatever
    they raise is taken as "cannot be read".
    """
    from rosbags.highlevel import AnyReader

    try:
        with AnyReader([Path(bag)]) as reader:
            present = {connection.topic for connection in reader.connections}
            missing = [topic for topic in topics if topic not in present]
            if missing:
                raise BagError(
                    f'{bag}: expected the topics {", ".join(missing)}; they are missing'
                )
            connections = [c for c in reader.connections if c.topic in topics]
            for connection, log_ns, data in reader.messages(connections=connections):
                message: Any = reader.deserialize(data, connection.msgtype)
                stamp_ns = to_stamp_ns(message.header.stamp)
                yield Recorded(connection.topic, log_ns, stamp_ns, message)
    except BagError:
        raise
    except Exception as error:
        raise BagError(f'{bag}: cannot be read: {error}') from error


def message_counts(bag: Path) -> dict[str, int]:
    """Return how many messages of each topic a recording has.

    Raises:
        BagError: It cannot be read.
    """
    from rosbags.highlevel import AnyReader

    try:
        with AnyReader([Path(bag)]) as reader:
            counts = Counter[str]()
            for each in reader.connections:
                counts[each.topic] += each.msgcount
            return dict(counts)
    except Exception as error:  # as in `read_messages`
        raise BagError(f'{bag}: cannot be read: {error}') from error


def _choose_episode(bag: Path, lane_states: Iterable[Recorded], episode: int | None) -> LaneStates:
    """Return the lane states of the episode that is meant by `read_trajectory`."""
    episodes = _split_episodes(lane_states)
    driven = [states for states in episodes if len(states) > 1] or episodes
    numbers = [states.last.episode for states in driven]
    if episode is None and len(driven) == 1:
        return driven[0]
    if episode not in numbers:
        wanted = 'one episode' if episode is None else f'episode {episode}'
        found = ', '.join(map(str, numbers)) or 'none'
        raise BagError(f'{bag}: expected {wanted}, got {found}')
    return driven[len(numbers) - 1 - numbers[::-1].index(episode)]


def _split_episodes(lane_states: Iterable[Recorded]) -> list[LaneStates]:
    """Begin an episode wherever its number changes or its steps begin again.

    An observation that waits for its answer is re-sent to late joiners: it counts once.
    """
    episodes: list[LaneStates] = []
    for recorded in lane_states:
        state = lane_state_from_message(recorded.message)
        if not episodes or episodes[-1].begins_another(recorded.stamp_ns, state):
            if episodes:
                episodes[-1].pack()
            episodes.append(LaneStates())
        episodes[-1].add(recorded.stamp_ns, recorded.log_ns, state)
    return episodes


def _pose(message: Any) -> tuple[float, ...]:
    position, orientation = message.pose.pose.position, message.pose.pose.orientation
    return (
        position.x,
        position.y,
        orientation.x,
        orientation.y,
        orientation.z,
        orientation.w,
    )


def _count_events(message: Any) -> tuple[int]:
    return (len(decode_events(message)),)


def decode_events(message: Any) -> Events:
    """Return the events of a packet.

    Raises:
        PacketError: They cannot be decoded.
    """
    from spikelane_sim import codecs

    return codecs.decode(
        message.encoding,
        message.events.tobytes(),
        stamp_ns=to_stamp_ns(message.header.stamp),
        time_base_ns=message.time_base,
        width=message.width,
        height=message.height,
    )


#: By topic: the kind of its messages (`step_messages.WIDTHS`), and what reads their values.
_KINDS: dict[str, tuple[str, Callable[[Any], tuple[float, ...]]]] = {
    ODOMETRY: ('pose', _pose),
    WHEELS: ('wheels', wheels_from_message),
    EVENTS: ('events', _count_events),
}
