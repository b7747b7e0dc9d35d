"""The lockstep protocol, real time and the states of a simulation."""

from __future__ import annotations

from collections.abc import Iterator
import textwrap
import threading

import pytest

from spikelane_sim import stepper as stepper_module
from spikelane_sim.contract import LaneState, Observation, WheelVelocities
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.run_state import Publish, RunState
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters
from spikelane_sim.stepper import Stepper

STEP_NS = 50_000_000
AHEAD = WheelVelocities(1.0, 1.0)
BACK = WheelVelocities(-2.0, -2.0)
STEP_M = 0.004875  # driven in a step at 1 rad/s


class World:
    """Records what is published, and plays the audience."""

    def __init__(self) -> None:
        self.published: list[tuple[int, bool]] = []
        self.observations: list[Observation] = []
        self.has_subscribers = True
        self.has_controller = True

    def publish(self, observation: Observation, is_new: bool) -> None:
        """Take an observation."""
        self.published.append((observation.stamp_ns // STEP_NS, is_new))
        self.observations.append(observation)

    @property
    def lane(self) -> LaneState:
        """The lane state published last."""
        lane = self.observations[-1].lane
        assert lane is not None
        return lane

    @property
    def driven_steps(self) -> float:
        """Steps at 1 rad/s that make the progress published last."""
        return self.lane.progress_m / STEP_M


@pytest.fixture
def world() -> World:
    """Give a world that hears and answers."""
    return World()


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    """Give a small and fast simulator whose episodes have at most 30 steps."""
    values = {'robot.model': 'kinematic', 'camera.width': 8, 'camera.height': 8}
    with Simulator(SimulatorParameters.from_mapping(values | {'episode.max_steps': 30})) as made:
        yield made


@pytest.fixture
def stepper(simulator: Simulator, world: World) -> Stepper:
    """Give a lockstep stepper, stopped."""
    return make_stepper(simulator, world)


@pytest.fixture
def realtime(simulator: Simulator, world: World) -> Stepper:
    """Give a stepper in real time whose commands hold for half a second, stopped."""
    return make_stepper(simulator, world, hold_ns=500_000_000)


def make_stepper(simulator: Simulator, world: World, hold_ns: int | None = None) -> Stepper:
    """Make a stepper that publishes to that world."""
    publish = Publish(world.publish, lambda: world.has_subscribers, lambda: world.has_controller)
    return Stepper(simulator, publish, seed=9, hold_ns=hold_ns)


class Progress:
    """Records how an advance goes on."""

    def __init__(self) -> None:
        self.calls: list[tuple[int, bool]] = []

    def __call__(self, completed: int, is_over: bool) -> None:
        """Take one report."""
        self.calls.append((completed, is_over))


# The table of states.

#: As in the module: what becomes of a state and phase; + is a step, - no change, ! an error.
TABLE = """
================  =======  =========  ========  ========  =========  ========  =======
state, phase      begin    answer     heard     play      pause      advance   stop
================  =======  =========  ========  ========  =========  ========  =======
stopped, none     playing  -          -         playing   paused     !         -
playing, held     playing  -          playing   -         paused/h   !         stopped
playing, waiting  playing  playing +  -         -         paused/w   !         stopped
paused, none      paused/w -          -         playing   -          steps     stopped
paused, held      paused/w -          paused/w  playing/h -          steps/h   stopped
paused, waiting   paused/w paused/a   -         playing   -          steps     stopped
paused, answered  paused/w -          -         playing + -          paused/w+ stopped
steps asked for   paused/w paused/w+  -         playing   -          !         stopped
quitting          -        -          -         -         -          !         -
================  =======  =========  ========  ========  =========  ========  =======
""".strip()
_ROW_STARTS = (0, 18, 27, 38, 48, 58, 69, 79)
_ROWS = [
    [line[a:b].strip() for a, b in zip(_ROW_STARTS, (*_ROW_STARTS[1:], None), strict=True)]
    for line in TABLE.splitlines()
    if not line.startswith('=')
]
#: How each state of the table is reached; a world without an audience holds observations.
_HELD_ROWS = ('playing, held', 'paused, held')
_PREPARE: dict[str, tuple[str, ...]] = {
    'stopped, none': (),
    'playing, held': ('begin',),
    'playing, waiting': ('begin',),
    'paused, none': ('pause',),
    'paused, held': ('pause', 'begin'),
    'paused, waiting': ('pause', 'begin'),
    'paused, answered': ('pause', 'begin', 'answer'),
    'steps asked for': ('pause', 'begin', 'advance'),
    'quitting': ('begin', 'quit'),
}
_SHORT = {
    'stopped': 'stopped, none',
    'playing': 'playing, waiting',
    'playing/h': 'playing, held',
    'paused': 'paused, none',
    'paused/h': 'paused, held',
    'paused/w': 'paused, waiting',
    'paused/a': 'paused, answered',
    'steps': 'steps asked for',
    'steps/h': 'steps held',
}


def do(stepper: Stepper, what: str) -> None:
    """Do what a column of the table says."""
    answered = stepper.observation.stamp_ns if stepper.observation else STEP_NS
    {
        'begin': stepper.begin,
        'answer': lambda: stepper.command(answered, AHEAD),
        'heard': lambda: stepper.audience_changed(has_grown=False),
        'play': stepper.play,
        'pause': stepper.pause,
        'advance': lambda: stepper.advance(1, Progress()),
        'stop': stepper.stop,
        'quit': stepper.quit,
    }[what]()


def row_of(stepper: Stepper) -> str:
    """Return which row of the table a stepper is in."""
    state, phase = stepper.state.name.lower(), stepper.phase.name.lower()
    if stepper.state is RunState.QUITTING:
        return 'quitting'
    if stepper.state is RunState.PAUSED and stepper._requested is not None:
        return 'steps held' if phase == 'held' else 'steps asked for'
    return f'{state}, {phase}'


def test_the_table_is_the_one_in_the_module() -> None:
    """Every cell of it is tested here."""
    assert stepper_module.__doc__ is not None
    assert textwrap.indent(TABLE, '    ') in stepper_module.__doc__
    assert [row[0] for row in _ROWS[1:]] == list(_PREPARE)


@pytest.mark.parametrize(
    ('row', 'what', 'becomes'),
    [
        (row[0], what, cell)
        for row in _ROWS[1:]
        for what, cell in zip(_ROWS[0][1:], row[1:], strict=True)
    ],
)
def test_each_state_becomes_what_the_table_says(
    stepper: Stepper, world: World, row: str, what: str, becomes: str
) -> None:
    """And takes a step where the table says so."""
    world.has_subscribers = row not in _HELD_ROWS
    for each in _PREPARE[row]:
        do(stepper, each)
    assert row_of(stepper) == row
    # Who has to hear it is there from now on, but for what leaves the observation held.
    world.has_subscribers = world.has_subscribers or what in ('begin', 'heard')
    if becomes == '!':
        with pytest.raises(SpikelaneError):
            do(stepper, what)
        assert (row_of(stepper), stepper.steps) == (row, 0)
        return
    do(stepper, what)
    is_step = becomes.endswith('+')
    expected = row if becomes == '-' else _SHORT[becomes.rstrip(' +')]
    assert (row_of(stepper), stepper.steps) == (expected, int(is_step))


def test_an_answer_after_the_episode_takes_no_step(stepper: Stepper) -> None:
    """The observation is answered, in play as in a pause."""
    stepper.begin()
    for step in range(1, 31):
        stepper.command(step * STEP_NS, AHEAD)
    assert row_of(stepper) == 'playing, waiting'
    stepper.command(31 * STEP_NS, AHEAD)
    assert (row_of(stepper), stepper.steps) == ('playing, answered', 30)
    stepper.pause()
    stepper.play()
    assert (row_of(stepper), stepper.steps) == ('playing, answered', 30)


# Lockstep.


def test_each_answer_takes_one_step(stepper: Stepper, world: World) -> None:
    """And publishes its observation, which waits for the next answer."""
    stepper.begin()
    assert stepper.is_waiting
    for step in (1, 2, 3):
        stepper.command(step * STEP_NS, AHEAD)
    assert world.published == [(1, True), (2, True), (3, True), (4, True)]
    assert (stepper.steps, stepper.ignored_commands) == (3, 0)
    assert world.driven_steps == pytest.approx(3)
    assert stepper.observation is world.observations[-1]


@pytest.mark.parametrize('stamp_ns', [0, STEP_NS - 1, 2 * STEP_NS, None])
def test_an_answer_with_another_stamp_changes_nothing(
    stepper: Stepper, world: World, stamp_ns: int | None
) -> None:
    """It is counted; the right one still takes the step."""
    stepper.begin()
    stepper.command(stamp_ns, BACK)
    assert (world.published, stepper.ignored_commands) == ([(1, True)], 1)
    stepper.command(STEP_NS, AHEAD)
    assert world.driven_steps == pytest.approx(1)


def test_a_second_answer_to_the_same_observation_is_ignored(
    stepper: Stepper, world: World
) -> None:
    """Its stamp has passed by then."""
    stepper.begin()
    stepper.command(STEP_NS, AHEAD)
    stepper.command(STEP_NS, BACK)
    assert (stepper.steps, stepper.ignored_commands) == (1, 1)
    assert world.driven_steps == pytest.approx(1)


def test_commands_before_an_episode_are_ignored(stepper: Stepper, world: World) -> None:
    """There is nothing to answer."""
    stepper.command(0, AHEAD)
    stepper.command(STEP_NS, AHEAD)
    assert (stepper.steps, stepper.ignored_commands, world.published) == (0, 2, [])


def test_a_controller_that_is_there_is_waited_for(stepper: Stepper) -> None:
    """No step is taken in its place."""
    stepper.begin()
    assert not stepper.advance_held()
    assert (stepper.steps, stepper.is_waiting) == (0, True)


def test_the_answer_to_the_last_observation_does_nothing(stepper: Stepper, world: World) -> None:
    """Controllers answer every observation; nobody is waited for then."""
    stepper.begin()
    for step in range(1, 31):
        stepper.command(step * STEP_NS, AHEAD)
    assert world.lane.terminated
    assert not stepper.is_waiting
    stepper.command(31 * STEP_NS, AHEAD)
    assert (stepper.steps, stepper.ignored_commands, len(world.published)) == (30, 0, 31)
    stepper.begin()
    assert world.published[-1] == (32, True)
    assert stepper.is_waiting


def test_a_reset_drops_the_answer_that_came_before_it(stepper: Stepper, world: World) -> None:
    """An observation that is gone has no answer."""
    stepper.begin()
    stepper.pause()
    stepper.command(STEP_NS, AHEAD)
    stepper.begin()
    stepper.play()
    assert (stepper.steps, world.published) == (0, [(1, True), (2, True)])
    stepper.command(STEP_NS, AHEAD)
    assert (stepper.steps, stepper.ignored_commands) == (0, 1)


def test_a_wrong_reset_changes_nothing(stepper: Stepper, world: World) -> None:
    """The observation still waits for its answer."""
    stepper.begin()
    with pytest.raises(SpikelaneError, match='lane: expected outer or inner'):
        stepper.begin('middle')
    assert world.published == [(1, True)]
    stepper.command(STEP_NS, AHEAD)
    assert stepper.steps == 1


# Publishing.


def test_nothing_is_published_until_all_hear_it(stepper: Stepper, world: World) -> None:
    """And who is told of the first observation waits as well."""
    world.has_subscribers = False
    told: list[Observation | None] = []
    stepper.begin(on_published=told.append)
    stepper.audience_changed()
    stepper.command(STEP_NS, AHEAD)
    assert (world.published, told, stepper.ignored_commands) == ([], [], 1)
    assert not stepper.is_waiting
    world.has_subscribers = True
    stepper.audience_changed()
    assert (world.published, told) == ([(1, True)], world.observations)
    stepper.command(STEP_NS, AHEAD)
    assert (world.published, told) == ([(1, True), (2, True)], world.observations[:1])


def test_who_waits_for_an_episode_that_never_shows_is_told(stepper: Stepper, world: World) -> None:
    """It gets None if another episode begins or all stops; a wrong reset replaces nothing."""
    world.has_subscribers = False
    told: dict[str, list[Observation | None]] = {'first': [], 'second': [], 'third': []}
    stepper.begin('inner', on_published=told['first'].append)
    with pytest.raises(SpikelaneError):
        stepper.begin('middle')
    assert told['first'] == []
    stepper.begin('outer', on_published=told['second'].append)
    stepper.reset_time(told['second'].append)
    assert (told['first'], told['second']) == ([None], [])
    stepper.stop()
    assert told['second'] == [None, None]
    stepper.begin(on_published=told['third'].append)
    world.has_subscribers = True
    stepper.audience_changed()
    assert told == {'first': [None], 'second': [None] * 2, 'third': world.observations}


def test_a_new_audience_gets_the_observation_that_waits(stepper: Stepper, world: World) -> None:
    """Marked as published before; one answer takes one step all the same."""
    stepper.begin()
    stepper.audience_changed()
    stepper.audience_changed()
    assert world.published == [(1, True), (1, False), (1, False)]
    stepper.command(STEP_NS, AHEAD)
    stepper.command(STEP_NS, AHEAD)
    assert (stepper.steps, stepper.ignored_commands) == (1, 1)


def test_a_new_audience_before_any_episode_gets_nothing(stepper: Stepper, world: World) -> None:
    """There is nothing."""
    stepper.audience_changed()
    assert world.published == []


def test_the_simulation_waits_for_a_listener_that_went_away(
    stepper: Stepper, world: World
) -> None:
    """The step is taken, its observation held back."""
    stepper.begin()
    world.has_subscribers = False
    stepper.command(STEP_NS, AHEAD)
    assert (stepper.steps, world.published) == (1, [(1, True)])
    world.has_subscribers = True
    stepper.audience_changed()
    assert world.published == [(1, True), (2, True)]


# States.


def test_a_simulation_is_stopped_until_it_begins(stepper: Stepper, world: World) -> None:
    """Play begins at time zero with the first seed."""
    assert (stepper.state, stepper.observation) == (RunState.STOPPED, None)
    stepper.play()
    assert (stepper.state, world.published) == (RunState.PLAYING, [(1, True)])
    assert (world.lane.lane, world.lane.episode) == ('outer', 1)


def test_a_pause_holds_the_answer_until_play(stepper: Stepper, world: World) -> None:
    """Only the first one counts."""
    stepper.begin()
    stepper.pause()
    stepper.command(STEP_NS, AHEAD)
    stepper.command(STEP_NS, BACK)
    assert (stepper.state, stepper.steps) == (RunState.PAUSED, 0)
    assert stepper.ignored_commands == 1
    stepper.play()
    assert stepper.steps == 1
    assert world.driven_steps == pytest.approx(1)
    stepper.play()
    assert stepper.steps == 1


def test_an_episode_that_begins_in_a_pause_is_shown_and_waits(
    stepper: Stepper, world: World
) -> None:
    """A reset does not end the pause."""
    stepper.pause()
    stepper.begin()
    assert (stepper.state, world.published) == (RunState.PAUSED, [(1, True)])
    assert not stepper.is_waiting


def test_stop_forgets_everything(stepper: Stepper, world: World, simulator: Simulator) -> None:
    """The next play begins at time zero, with the first seed and lane."""
    stepper.begin('inner', 4)
    stepper.command(STEP_NS, AHEAD)
    stepper.stop()
    assert (stepper.state, stepper.observation) == (RunState.STOPPED, None)
    stepper.command(2 * STEP_NS, AHEAD)
    with pytest.raises(SpikelaneError):
        stepper.reset_time(lambda observation: None)
    with pytest.raises(SpikelaneError):
        stepper.place(1.0, 1.0, 0.0)
    stepper.play()
    assert world.published[-1] == (1, True)
    assert (world.lane.lane, world.lane.episode, simulator.seed) == ('outer', 1, 9)
    assert stepper.steps == 1


def test_a_stopped_robot_is_where_the_next_episode_begins(stepper: Stepper) -> None:
    """At rest, at time 0; so it is before the first one."""
    stamp_ns, before = stepper.robot()
    assert (stamp_ns, before.position[:2]) == (0, (3.0, 0.25))
    stepper.begin('inner')
    stepper.command(STEP_NS, AHEAD)
    stepper.stop()
    assert stepper.robot() == (0, before)
    stepper.pause()
    assert stepper.robot() == (0, before)


def test_a_reset_after_a_stop_begins_at_time_zero(
    stepper: Stepper, world: World, simulator: Simulator
) -> None:
    """On the lane and with the seed asked for, else with the first ones; also in a pause."""
    stepper.begin('inner', 4)
    stepper.command(STEP_NS, AHEAD)
    stepper.stop()
    stepper.begin()
    assert (world.published[-1], world.lane.lane, simulator.seed) == ((1, True), 'outer', 9)
    stepper.stop()
    stepper.pause()
    stepper.begin('inner', 5)
    assert (world.published[-1], world.lane.lane, simulator.seed) == ((1, True), 'inner', 5)


def test_episodes_follow_each_other_in_time(stepper: Stepper, world: World) -> None:
    """Time goes on, lanes take turns, and a full reset begins at the beginning."""
    stepper.begin()
    stepper.begin()
    assert (world.published[-1], world.lane.lane, world.lane.episode) == ((2, True), 'inner', 2)
    stepper.begin(from_time_zero=True)
    assert (world.published[-1], world.lane.lane, world.lane.episode) == ((1, True), 'outer', 1)


def test_a_reset_of_time_goes_on_with_the_episode(stepper: Stepper, world: World) -> None:
    """Answers carry the new stamps."""
    stepper.begin()
    stepper.command(STEP_NS, AHEAD)
    told: list[Observation | None] = []
    stepper.reset_time(told.append)
    assert (world.published[-1], world.lane.step) == ((1, True), 1)
    assert told == world.observations[-1:]
    stepper.command(STEP_NS, AHEAD)
    assert world.driven_steps == pytest.approx(2)


def test_a_robot_is_placed_between_two_steps(stepper: Stepper, world: World) -> None:
    """The next observation is from there."""
    stepper.begin()
    stepper.place(5.0, 0.25, 0.0)
    stepper.command(STEP_NS, AHEAD)
    assert world.lane.position_m == pytest.approx(2.5 + STEP_M)


# Single steps.


def test_steps_of_a_paused_simulation_are_answered(stepper: Stepper, world: World) -> None:
    """Then it pauses again."""
    stepper.begin()
    stepper.pause()
    progress = Progress()
    stepper.advance(2, progress)
    assert stepper.is_waiting
    assert not stepper.advance_held()
    stepper.command(STEP_NS, AHEAD)
    stepper.command(2 * STEP_NS, AHEAD)
    assert progress.calls == [(1, False), (2, True)]
    assert not stepper.is_waiting
    stepper.command(3 * STEP_NS, AHEAD)
    assert (stepper.steps, stepper.state) == (2, RunState.PAUSED)
    assert world.driven_steps == pytest.approx(2)


def test_an_answer_that_is_there_takes_the_first_step_at_once(stepper: Stepper) -> None:
    """It came in the pause."""
    stepper.begin()
    stepper.pause()
    stepper.command(STEP_NS, AHEAD)
    progress = Progress()
    stepper.advance(1, progress)
    assert (progress.calls, stepper.steps) == ([(1, True)], 1)


def test_steps_without_a_controller_hold_the_last_command(stepper: Stepper, world: World) -> None:
    """At the beginning of an episode, standstill."""
    world.has_controller = False
    stepper.begin()
    stepper.pause()
    progress = Progress()
    stepper.advance(1, progress)
    assert [stepper.advance_held() for _ in range(2)] == [True, False]
    assert world.driven_steps == 0
    stepper.play()
    stepper.command(2 * STEP_NS, AHEAD)
    stepper.pause()
    stepper.advance(3, progress)
    assert [stepper.advance_held() for _ in range(4)] == [True, True, True, False]
    assert world.driven_steps == pytest.approx(4)
    assert progress.calls == [(1, True), (1, False), (2, False), (3, True)]


def test_steps_of_a_simulation_that_has_not_begun_begin_it(stepper: Stepper, world: World) -> None:
    """At time zero with the first seed."""
    stepper.pause()
    stepper.advance(1, Progress())
    assert world.published == [(1, True)]


def test_steps_end_with_the_episode(stepper: Stepper) -> None:
    """Fewer were taken than asked for."""
    stepper.begin()
    stepper.pause()
    progress = Progress()
    stepper.advance(100, progress)
    for step in range(1, 31):
        stepper.command(step * STEP_NS, AHEAD)
    assert (len(progress.calls), progress.calls[-1]) == (30, (30, True))
    with pytest.raises(SpikelaneError, match='the episode is over'):
        stepper.advance(1, progress)


def test_steps_can_be_cancelled(stepper: Stepper) -> None:
    """Once; what was taken is told."""
    stepper.begin()
    stepper.pause()
    progress = Progress()
    stepper.advance(5, progress)
    stepper.command(STEP_NS, AHEAD)
    stepper.cancel_advance()
    stepper.cancel_advance()
    assert progress.calls == [(1, False), (1, True)]
    stepper.command(2 * STEP_NS, AHEAD)
    assert stepper.steps == 1


def test_a_stop_cancels_the_steps(stepper: Stepper) -> None:
    """Who waits for them is told."""
    stepper.begin()
    stepper.pause()
    progress = Progress()
    stepper.advance(5, progress)
    stepper.stop()
    assert progress.calls == [(0, True)]


def test_steps_are_refused_unless_paused_and_free(stepper: Stepper) -> None:
    """One at a time."""
    for prepare in (lambda: None, stepper.begin):
        prepare()
        with pytest.raises(SpikelaneError, match='only while the simulation is paused'):
            stepper.advance(1, Progress())
    stepper.pause()
    stepper.advance(1, Progress())
    with pytest.raises(SpikelaneError, match='other steps are being taken'):
        stepper.advance(1, Progress())


# Real time.


def test_real_time_steps_by_the_clock(realtime: Stepper, world: World) -> None:
    """Only while it plays; no answer is waited for."""
    realtime.tick()
    realtime.begin()
    realtime.tick()
    realtime.pause()
    realtime.tick()
    assert (realtime.steps, world.published) == (1, [(1, True), (2, True)])
    assert not realtime.is_waiting
    realtime.play()
    for _ in range(40):
        realtime.tick()
    assert (realtime.steps, world.lane.reason) == (30, 'step_limit')


def test_a_command_holds_for_half_a_second_of_simulation(realtime: Stepper, world: World) -> None:
    """That is ten steps, whatever its stamp; then the wheels stand."""
    realtime.begin()
    realtime.tick()
    realtime.command(None, AHEAD)
    driven = []
    for _ in range(12):
        realtime.tick()
        driven.append(round(world.driven_steps, 6))
    assert driven == [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 10, 10]
    realtime.command(12345, AHEAD)
    realtime.tick()
    assert world.driven_steps == pytest.approx(11)


def test_a_command_holds_for_one_step_at_least(simulator: Simulator, world: World) -> None:
    """Where it is told to hold for no time at all."""
    stepper = make_stepper(simulator, world, hold_ns=0)
    stepper.begin()
    stepper.command(None, AHEAD)
    stepper.tick()
    stepper.tick()
    assert world.driven_steps == pytest.approx(1)


def test_the_last_command_before_a_tick_counts(realtime: Stepper, world: World) -> None:
    """None is ignored."""
    realtime.begin()
    realtime.command(None, BACK)
    realtime.command(None, AHEAD)
    realtime.tick()
    assert world.driven_steps == pytest.approx(1)
    assert realtime.ignored_commands == 0


def test_an_episode_in_real_time_begins_at_rest(realtime: Stepper, world: World) -> None:
    """The command of the one before is not held."""
    realtime.begin()
    realtime.command(None, AHEAD)
    realtime.begin()
    realtime.tick()
    assert world.driven_steps == 0


def test_steps_in_real_time_hold_the_last_command(realtime: Stepper, world: World) -> None:
    """Though a controller is there."""
    realtime.begin()
    realtime.pause()
    realtime.command(None, AHEAD)
    progress = Progress()
    realtime.advance(2, progress)
    assert [realtime.advance_held() for _ in range(3)] == [True, True, False]
    assert progress.calls == [(1, False), (2, True)]
    assert world.driven_steps == pytest.approx(2)


# Threads.


def test_answers_and_requests_from_several_threads_lose_no_step(
    simulator: Simulator, world: World
) -> None:
    """Four threads answer every stamp, a fifth pauses, plays and asks: each step happens once."""
    stepper = make_stepper(simulator, world)
    stepper.begin()
    done = threading.Event()

    def answer() -> None:
        while not done.is_set():
            observation = stepper.observation
            assert observation is not None
            stepper.command(observation.stamp_ns, AHEAD)

    def disturb() -> None:
        while not done.is_set():
            stepper.pause()
            stepper.audience_changed()
            stepper.play()

    threads = [threading.Thread(target=target) for target in (*[answer] * 4, disturb)]
    for thread in threads:
        thread.start()
    for _ in range(1000):
        if stepper.steps == 30:
            break
        done.wait(0.01)
    done.set()
    for thread in threads:
        thread.join()
    new = [number for number, is_new in world.published if is_new]
    assert new == list(range(1, 32))
    assert stepper.steps == 30
    assert world.driven_steps == pytest.approx(30)
