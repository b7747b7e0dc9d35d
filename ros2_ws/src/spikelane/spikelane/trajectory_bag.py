"""The trajectory of an episode, read from a recording of the graph."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from spikelane.trajectory import Pose, Trajectory, trajectory_from_messages, TrajectoryError
from spikelane_sim.errors import BagError, MessageError, PacketError
from spikelane_sim.messages import lane_state_from_message, to_stamp_ns, wheels_from_message

LANE_STATE = '/lane/state'
ODOMETRY = '/ground_truth/odom'
WHEELS = '/wheel_velocities'
EVENTS = '/event_camera/events'


class _Recorded(NamedTuple):
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
    lane_states = _choose_episode(bag, _read(bag, [LANE_STATE]), episode)
    logged_ns = {recorded.stamp_ns: recorded.log_ns for recorded in lane_states}
    nearest: dict[tuple[str, int], _Recorded] = {}
    for recorded in _read(bag, [ODOMETRY, WHEELS, EVENTS]):
        key = recorded.topic, recorded.stamp_ns
        at_ns = logged_ns.get(recorded.stamp_ns)
        if at_ns is None:
            continue
        if key not in nearest or abs(recorded.log_ns - at_ns) < abs(nearest[key].log_ns - at_ns):
            nearest[key] = recorded
    try:
        return trajectory_from_messages(
            [
                (recorded.stamp_ns, lane_state_from_message(recorded.message))
                for recorded in lane_states
            ],
            {s: _pose(r.message) for (topic, s), r in nearest.items() if topic == ODOMETRY},
            {
                s: wheels_from_message(r.message)
                for (topic, s), r in nearest.items()
                if topic == WHEELS
            },
            {s: _count_events(r.message) for (topic, s), r in nearest.items() if topic == EVENTS},
        )
    except (TrajectoryError, PacketError, MessageError) as error:
        raise BagError(f'{bag}: {error}') from None


def _read(bag: Path, topics: Sequence[str]) -> Iterator[_Recorded]:
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
                yield _Recorded(connection.topic, log_ns, stamp_ns, message)
    except BagError:
        raise
    except Exception as error:
        raise BagError(f'{bag}: cannot be read: {error}') from error


def _choose_episode(
    bag: Path, lane_states: Iterable[_Recorded], episode: int | None
) -> list[_Recorded]:
    """Return the lane states of the episode that is meant by `read_trajectory`."""
    episodes = _split_episodes(lane_states)
    driven = [states for states in episodes if len(states) > 1] or episodes
    numbers = [states[0].message.episode for states in driven]
    if episode is None and len(driven) == 1:
        return driven[0]
    if episode not in numbers:
        wanted = 'one episode' if episode is None else f'episode {episode}'
        found = ', '.join(map(str, numbers)) or 'none'
        raise BagError(f'{bag}: expected {wanted}, got {found}')
    return driven[len(numbers) - 1 - numbers[::-1].index(episode)]


def _split_episodes(lane_states: Iterable[_Recorded]) -> list[list[_Recorded]]:
    """Begin an episode wherever its number changes or its steps begin again.

    An observation that waits for its answer is sent again to whoever joins then: it counts once.
    """
    episodes: list[list[_Recorded]] = []
    before = None
    for recorded in lane_states:
        now = recorded.message
        if before is not None and _is_repeated(recorded, episodes[-1][-1]):
            episodes[-1][-1] = recorded
            continue
        if before is None or now.episode != before.episode or now.step <= before.step:
            episodes.append([])
        episodes[-1].append(recorded)
        before = now
    return episodes


def _is_repeated(recorded: _Recorded, last: _Recorded) -> bool:
    now, before = recorded.message, last.message
    return bool(
        (recorded.stamp_ns, now.episode, now.step) == (last.stamp_ns, before.episode, before.step)
    )


def _pose(message: Any) -> Pose:
    position, orientation = message.pose.pose.position, message.pose.pose.orientation
    return Pose(
        (position.x, position.y, position.z),
        (orientation.x, orientation.y, orientation.z, orientation.w),
    )


def _count_events(message: Any) -> int:
    from spikelane_sim import codecs

    events = codecs.decode(
        message.encoding,
        message.events.tobytes(),
        stamp_ns=to_stamp_ns(message.header.stamp),
        time_base_ns=message.time_base,
        width=message.width,
        height=message.height,
    )
    return len(events)
