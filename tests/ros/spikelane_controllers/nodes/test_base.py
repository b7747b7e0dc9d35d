"""Controller nodes with `command`: what a robot's base hears on `cmd_vel`, and how soon it stops.

Times are measured from the last message before a silence, as it is published, to the first stop,
as a subscriber receives it. The smallest of several is compared with the quarter of a second in
which a robot is to be stopped: on a busy machine any process may have to wait for a processor.
"""

from collections.abc import Callable, Iterator, Sequence
import contextlib
import itertools
import signal
import sys
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import Twist, TwistStamped
import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Joy
from spikelane_msgs.msg import LaneState, WheelVelocities
from std_msgs.msg import Bool

from spikelane_sim.events import EVENT_DTYPE, no_events
from spikelane_sim.nodes import conversions

pytestmark = pytest.mark.ros

STEP_NS = 50_000_000
STOP_WITHIN_S = 0.25
ROUNDS = 4
#: Without events the Braitenberg controller drives straight on with 1 rad/s.
GEOMETRY = {'base.wheel_radius_m': 0.1, 'base.track_m': 0.5}
AHEAD = (0.1, 0.0)
#: A node of a controller that takes 80 ms to answer 50 ms.
SLOW_NODE = """
import time

from spikelane_controllers.braitenberg.controller import Braitenberg
from spikelane_controllers.nodes.main import main

step = Braitenberg.step
Braitenberg.step = lambda self, observation: (time.sleep(0.08), step(self, observation))[1]
main('braitenberg')
"""
_numbers = itertools.count()


def velocity(message: Any) -> Any:
    """Return the Twist of a Twist or a TwistStamped."""
    return getattr(message, 'twist', message)


class Stream:
    """Publishes something 20 times a second, until it is told to be silent."""

    def __init__(self, publish: Callable[[], None]) -> None:
        self._publish = publish
        self._is_silent = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.last_s = 0.0
        self._thread.start()

    def _run(self) -> None:
        while not self._is_silent.is_set():
            self.last_s = time.monotonic()
            self._publish()
            self._is_silent.wait(STEP_NS / 1e9)

    def end(self) -> float:
        """Be silent; return when the last message was published."""
        self._is_silent.set()
        self._thread.join()
        return self.last_s


class Base:
    """A node that drives a base, in a namespace of its own; its camera; what the base hears."""

    def __init__(
        self,
        graph: Any,
        parameters: dict[str, Any],
        *arguments: str,
        run_by: Sequence[str] = (),
    ) -> None:
        self.graph, self.node = graph, graph.node
        self.space = space = f'/base{next(_numbers)}'
        self.heard: list[tuple[float, Any]] = []
        self.wheels: list[WheelVelocities] = []
        self.diagnostics: list[DiagnosticStatus] = []
        kind = TwistStamped if parameters.get('command') == 'twist_stamped' else Twist
        self.subscribe(kind, 'cmd_vel', lambda each: self.heard.append((time.monotonic(), each)))
        self.subscribe(WheelVelocities, 'wheel_velocities', self.wheels.append)
        self.subscribe(
            DiagnosticArray, 'diagnostics', lambda each: self.diagnostics.append(each.status[0])
        )
        self.packets = self.node.create_publisher(EventPacket, f'{space}/event_camera/events', 10)
        self._stamp_ns, self.events = STEP_NS, no_events()
        self._sequence = itertools.count()
        given = {'command': 'twist', 'use_lane_state': False, **GEOMETRY, **parameters}
        names = ('-r', f'__ns:={space}', '-r', f'/diagnostics:={space}/diagnostics')
        self.process = graph.start('braitenberg', given, *names, *arguments, run_by=run_by)
        graph.until(self.packets.get_subscription_count, 'the node')
        graph.until(lambda: self.node.count_publishers(f'{space}/cmd_vel'), 'cmd_vel')
        graph.until(lambda: 'ready: ' in self.process.log, 'the word that it is ready')

    def subscribe(self, kind: type, topic: str, handle: Callable[[Any], None]) -> None:
        """Subscribe to a topic of the node's."""
        self.node.create_subscription(kind, f'{self.space}/{topic}', handle, 100)

    def publisher(self, kind: type, topic: str) -> Any:
        """Return a publisher that the node has met."""
        publisher = self.node.create_publisher(kind, f'{self.space}/{topic}', 10)
        self.graph.until(publisher.get_subscription_count, topic)
        return publisher

    def see(self) -> int:
        """Let the camera publish the next 50 ms; return their stamp."""
        self._stamp_ns += STEP_NS
        packet = EventPacket(width=128, height=128)
        events = self.events.copy()
        events['t'] = self._stamp_ns - STEP_NS
        conversions.fill_event_packet(packet, events, self._stamp_ns, next(self._sequence), 'evt3')
        self.packets.publish(packet)
        return self._stamp_ns

    @contextlib.contextmanager
    def seeing(self) -> Iterator[Stream]:
        """Let the camera publish meanwhile."""
        camera = Stream(self.see)
        try:
            yield camera
        finally:
            camera.end()

    @property
    def last(self) -> tuple[float, float]:
        """What the base heard last."""
        twist = velocity(self.heard[-1][1])
        return twist.linear.x, twist.angular.z

    def until_it_drives(self) -> None:
        """Wait until the base hears to drive straight on."""
        before = len(self.heard)
        expected = pytest.approx(AHEAD)
        self.graph.until(lambda: len(self.heard) > before and self.last == expected, 'a drive')

    def until_it_stands(self) -> float:
        """Wait until the base hears to stand; return when it did so first."""
        self.graph.until(lambda: self.last == (0.0, 0.0), 'a stop')
        stops = itertools.takewhile(
            lambda each: velocity(each[1]).linear.x == 0.0, reversed(self.heard)
        )
        *_, (first_s, _) = stops
        return first_s

    def until_said(self, text: str) -> None:
        """Wait until the node's log has a text."""
        self.graph.until(lambda: text in self.process.log, text)

    def wait(self, seconds: float) -> None:
        """Let some time pass."""
        since_s = time.monotonic()
        self.graph.until(lambda: time.monotonic() - since_s > seconds)


def smallest(measure: Callable[[], float]) -> float:
    """Return the smallest of several times, and print them all."""
    times_s = [measure() for _ in range(ROUNDS)]
    print('stopped after', [round(each, 3) for each in times_s], 's')
    return min(times_s)


def test_a_twist_is_published_in_addition_to_wheel_velocities(graph: Any) -> None:
    """What both wheels mean for the body; both are there for each step."""
    base = Base(graph, {})
    base.until_said('wheel radius 0.1 m, track 0.5 m, at most 0.5 m/s and 1.5 rad/s')
    rng = np.random.default_rng(1)
    base.events = np.zeros(300, EVENT_DTYPE)
    base.events['x'] = rng.integers(0, 60, 300)  # on the left alone: it turns
    base.events['y'] = np.sort(rng.integers(64, 104, 300))
    base.events['polarity'] = 1
    with base.seeing():
        graph.until(lambda: base.heard and base.last[1] != 0.0, 'a turn')
    base.wait(0.5)
    wheels = base.wheels[-1]
    driven = [twist for _, twist in base.heard if twist.linear.x != 0.0]
    assert wheels.left != wheels.right
    forward = 0.1 * (wheels.left + wheels.right) / 2
    turn = 0.1 * (wheels.right - wheels.left) / 0.5
    assert (driven[-1].linear.x, driven[-1].angular.z) == pytest.approx((forward, turn))
    assert base.process.stop(signal.SIGTERM) == 0
    assert 'Traceback' not in base.process.log


def test_the_wheels_alone_are_published_by_default(graph: Any) -> None:
    """No node publishes cmd_vel that was not asked to."""
    space = f'/base{next(_numbers)}'
    process = graph.start('braitenberg', {'use_lane_state': False}, '-r', f'__ns:={space}')
    graph.until(lambda: 'ready: ' in process.log, 'the word that it is ready')
    graph.until(lambda: graph.node.count_publishers(f'{space}/wheel_velocities'), 'its topics')
    assert graph.node.count_publishers(f'{space}/cmd_vel') == 0
    process.kill()


def test_a_base_is_stopped_soon_after_the_last_events(graph: Any) -> None:
    """Within a quarter of a second and three times; it drives again with the next events."""
    base = Base(graph, {})

    def measure() -> float:
        with base.seeing() as camera:
            base.until_it_drives()
        return base.until_it_stands() - camera.last_s

    assert smallest(measure) <= STOP_WITHIN_S
    base.wait(0.5)
    stops = itertools.takewhile(lambda each: each[1].linear.x == 0.0, reversed(base.heard))
    assert len(list(stops)) == 3
    base.until_said('event_camera/events: none came for 0.2 s; the robot is stopped')
    base.until_said('event_camera/events: they come again')

    def timeouts() -> int:
        values = {pair.key: pair.value for pair in base.diagnostics[-1].values}
        return int(values['base_timeouts'])

    graph.until(lambda: timeouts() >= ROUNDS, 'diagnostics of all stops')
    assert base.diagnostics[-1].level == DiagnosticStatus.WARN
    assert 'the robot is stopped: event_camera/events: none' in base.diagnostics[-1].message
    base.process.kill()


def test_a_base_is_stopped_soon_after_the_last_lane_state(graph: Any) -> None:
    """Where the controller uses it, though events go on."""
    base = Base(graph, {'use_lane_state': True})
    lanes = base.publisher(LaneState, 'lane/state')
    steps = itertools.count()

    def see_both() -> None:
        lane = LaneState(lane='outer', episode=1, step=next(steps))
        lane.header.stamp = conversions.to_time(base.see())
        lanes.publish(lane)

    def measure() -> float:
        both = Stream(see_both)
        try:
            base.until_it_drives()
        finally:
            last_s = both.end()
        with base.seeing():
            return base.until_it_stands() - last_s

    assert smallest(measure) <= STOP_WITHIN_S
    base.until_said('lane/state: none came for 0.2 s; the robot is stopped')
    base.process.kill()


@pytest.mark.parametrize('kind', ['joystick', 'bool'])
def test_a_base_stands_without_the_dead_man_switch(graph: Any, kind: str) -> None:
    """It is stopped soon when it is released, and when the link to it is lost."""
    base = Base(graph, {'base.dead_man': kind, 'base.dead_man_button': 2})
    if kind == 'joystick':
        publisher = base.publisher(Joy, 'joy')
        messages = [Joy(buttons=[1, 1, held, 1]) for held in (0, 1)]
    else:
        publisher = base.publisher(Bool, 'dead_man_switch')
        messages = [Bool(data=held) for held in (False, True)]
    is_held = True

    def measure_release() -> float:
        nonlocal is_held
        is_held = True
        base.until_it_drives()
        is_held, released_s = False, time.monotonic()
        return base.until_it_stands() - released_s

    def measure_silence() -> float:
        link = Stream(lambda: publisher.publish(messages[1]))
        try:
            base.until_it_drives()
        finally:
            last_s = link.end()
        return base.until_it_stands() - last_s

    with base.seeing():
        base.wait(1.0)
        assert base.heard == []
        link = Stream(lambda: publisher.publish(messages[is_held]))
        try:
            assert smallest(measure_release) <= STOP_WITHIN_S
        finally:
            link.end()
        assert smallest(measure_silence) <= STOP_WITHIN_S
    base.until_said('dead-man switch: not held; the robot is stopped')
    base.until_said('dead-man switch: none came for 0.2 s; the robot is stopped')
    base.process.kill()


def test_a_joystick_without_the_button_is_named(graph: Any) -> None:
    """It holds nothing."""
    base = Base(graph, {'base.dead_man': 'joystick', 'base.dead_man_button': 9})
    publisher = base.publisher(Joy, 'joy')
    joystick = Stream(lambda: publisher.publish(Joy(buttons=[1, 1])))
    try:
        with base.seeing():
            base.until_said('joy: expected a button 9, got 2 buttons; taken as not held')
    finally:
        joystick.end()
    assert base.heard == []
    base.process.kill()


def test_a_base_is_stopped_soon_when_too_many_events_come(graph: Any) -> None:
    """200,000 a second, where 50,000 are allowed; it drives on when there are fewer."""
    base = Base(graph, {'max_events_per_s': 50_000.0})
    flood = np.zeros(10_000, EVENT_DTYPE)
    flood['x'] = np.arange(10_000) % 128
    flood['y'] = np.arange(10_000) // 128
    flood['polarity'] = 1

    def measure() -> float:
        base.events = no_events()
        base.until_it_drives()
        since_s, base.events = time.monotonic(), flood
        return base.until_it_stands() - since_s

    with base.seeing():
        assert smallest(measure) <= STOP_WITHIN_S
        base.until_said('events: expected at most 50000 a second, got ')
        base.events = no_events()
        base.until_it_drives()
    base.process.kill()


def test_a_base_is_stopped_where_its_node_lags_behind_the_camera(graph: Any) -> None:
    """No answer is late enough for a timeout, but each is later than the one before."""
    base = Base(graph, {}, run_by=(sys.executable, '-c', SLOW_NODE))
    with base.seeing():
        base.until_it_drives()
        base.until_it_stands()
        base.until_said('events: expected to be answered within 0.2 s, waited 0.2')
    base.wait(1.0)  # until none wait
    with base.seeing():
        base.until_it_drives()
    base.process.kill()


def test_a_base_speeds_up_by_its_acceleration(graph: Any) -> None:
    """By 0.2 m/s2 and 50 ms about 0.01 m/s a step: 0.1 m/s take half a second."""
    base = Base(graph, {'base.max_linear_m_s2': 0.2})
    with base.seeing():
        base.until_it_drives()
    speeds = [twist.linear.x for _, twist in base.heard]
    speeds = speeds[: next(n for n, speed in enumerate(speeds) if speed == pytest.approx(0.1)) + 1]
    changes = np.diff([0.0, *speeds])
    assert (changes > 0).all()
    assert changes.max() <= 0.02 + 1e-9  # of a tenth of a second
    assert len(speeds) >= 5
    base.process.kill()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_is_told_to_end_stops_its_base(graph: Any, number: int) -> None:
    """The last that the base hears is to stand."""
    base = Base(graph, {})
    with base.seeing():
        base.until_it_drives()
        base.process.send(number)
        graph.until(lambda: base.process.status is not None, 'its end')
    assert base.process.status == 0
    base.until_it_stands()
    assert 'Traceback' not in base.process.log


def test_with_simulation_time_the_timeout_is_the_simulations(graph: Any) -> None:
    """While it stands still nothing is stopped; stamps of twists are its too."""
    space = f'/base{next(_numbers)}'
    publisher = graph.node.create_publisher(Clock, f'{space}/clock', 10)
    base = Base(
        graph,
        {'command': 'twist_stamped', 'use_sim_time': True, 'base.frame_id': 'axle'},
        *('-r', f'/clock:={space}/clock'),
    )
    graph.until(publisher.get_subscription_count, 'the clock')

    def tick(seconds: int) -> None:
        clock = Clock()
        clock.clock.sec = seconds
        publisher.publish(clock)

    def is_stamped() -> bool:
        tick(7)
        return bool(base.heard) and base.heard[-1][1].header.stamp.sec == 7

    with base.seeing():
        graph.until(is_stamped, 'simulation time')
        base.until_it_drives()
    assert base.heard[-1][1].header.frame_id == 'axle'
    base.wait(1.0)
    assert base.last == pytest.approx(AHEAD)
    tick(8)
    base.until_it_stands()
    base.process.kill()
