"""Replays: exact where they should be, and honest about what is missing."""

from collections.abc import Callable
import csv
import dataclasses
import json
import math
from pathlib import Path
import re
from typing import Any

import numpy as np
import pytest

from spikelane.bag.drive import RecordedDrive
from spikelane.main import run
from spikelane.runs.configuration import Request
from spikelane.runs.replay.config import ReplayConfig
from spikelane.runs.replay.metrics import compare, drive_metrics, summarise
from spikelane.runs.replay.run import replay
from spikelane_controllers.controller_host import ControllerHost
from spikelane_controllers.learning.training import Training, TrainingParameters
from spikelane_controllers.registry import make_controller
from spikelane_sim.errors import BagError, ParameterError
from spikelane_sim.events import make_events
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

DATA = Path(__file__).parents[4] / 'data'
CAMERAS = Path(__file__).parents[6] / 'shared' / 'data' / 'real_cameras'
if not CAMERAS.is_dir():
    CAMERAS = Path('/work/shared/data/real_cameras')
SEED = 5
OBSERVATIONS = 31 + 21 + 26

BagOf = Callable[..., Path]


def replayed(
    bag: Path, controller: str = 'braitenberg', seed: int = SEED, **options: Any
) -> dict[str, Any]:
    """Replay a bag; return what is measured."""
    drive = RecordedDrive(bag, options.pop('events_topic', None))
    asked = Request(
        options.pop('scenario', '1'), controller, seed, parameters=options.pop('parameters', {})
    )
    result = replay(ReplayConfig.make(asked, bag, **options), drive)
    return summarise(drive, result.answers, result.sensor)


@pytest.fixture(scope='module')
def said(drives, braitenberg_drive) -> list[Any]:
    """Give what was said on the graph."""
    return drives.say(braitenberg_drive)


def without(said: list[Any], topic: str) -> list[Any]:
    """Return what was said on other topics."""
    return [each for each in said if each.topic != topic]


# --- agreement ------------------------------------------------------------------------------


def test_who_drove_gives_the_same_answers(
    said: list[Any], bag_of: BagOf, braitenberg_drive
) -> None:
    """To the last bit, over episodes; the distances are those in the bag."""
    result = replayed(bag_of(said))
    assert (result['agreement'], result['answers']) == (1.0, OBSERVATIONS)
    assert result['first_difference'] is None
    assert result['largest_difference_rad_s'] == 0
    assert (result['steps'], result['observations']) == (30 + 20 + 25, OBSERVATIONS)
    assert result['notes'] == []
    lanes = [seen.observation.lane for seen in braitenberg_drive]
    distances = [abs(lane.distance_m) for lane in lanes if lane.step > 0]
    assert result['mean_abs_distance_m'] == pytest.approx(sum(distances) / 75, rel=1e-12)
    assert result['max_abs_distance_m'] == max(distances)
    assert [each['steps'] for each in result['episodes']] == [30, 20, 25]
    assert [each['lane'] for each in result['episodes']] == ['outer', 'inner', 'outer']
    events = sum(len(seen.observation.events) for seen in braitenberg_drive)
    assert result['events']['on'] + result['events']['off'] == events > 1000


@pytest.mark.parametrize('seed', [0, 6])
def test_another_seed_gives_other_answers(said: list[Any], bag_of: BagOf, seed: int) -> None:
    """Not at first, as the first observation has no events."""
    result = replayed(bag_of(said), seed=seed)
    assert 0 < result['agreement'] < 0.9
    assert result['equal'] == round(result['agreement'] * OBSERVATIONS)
    assert 1 <= result['first_difference'] < 31
    at = result['first_difference_at']
    assert (at['episode'], at['step']) == (1, result['first_difference'])
    assert at['stamp_ns'] == (result['first_difference'] + 1) * 50_000_000
    assert at['recorded'] != at['replayed']
    assert result['largest_difference_rad_s'] > 0


def test_another_controller_is_compared_too(said: list[Any], bag_of: BagOf) -> None:
    """It answers otherwise."""
    assert replayed(bag_of(said), 'rstdp')['agreement'] < 0.9


@pytest.mark.parametrize('scenario', ['1', '2'])
def test_learnt_weights_give_the_same_answers(drives, bag_of: BagOf, scenario: str) -> None:
    """The network lives on from episode to episode."""
    parameters = {'checkpoint': f'scenario_{scenario}'}
    seen = drives.drive('rstdp', seed=2, episodes=(20, 30), parameters=parameters)
    bag = bag_of(drives.say(seen))
    assert replayed(bag, 'rstdp', 2, scenario=scenario)['agreement'] == 1.0
    other = '2' if scenario == '1' else '1'
    assert replayed(bag, 'rstdp', 2, scenario=other)['agreement'] < 1.0


def test_a_training_gives_the_same_answers(drives, bag_of: BagOf, tmp_path: Path) -> None:
    """From the initial weights of its seed on."""
    learning = {'learning': True, 'checkpoint': '', 'initial_weights.high_pa': 3000.0}
    training = Training(
        'rstdp',
        make_controller('rstdp', learning),
        TrainingParameters(steps=1000),
        {},
        tmp_path / 'checkpoint.safetensors',
    )
    training.begin(3)
    seen = drives.drive(training, seed=3, episodes=(40, 40))
    parameters = {f'rstdp.{name}': value for name, value in learning.items()}
    bag = bag_of(drives.say(seen))
    assert replayed(bag, 'rstdp', 3, parameters=parameters)['agreement'] == 1.0
    parameters['rstdp.learning'] = False
    assert replayed(bag, 'rstdp', 3, parameters=parameters)['agreement'] < 1.0


@pytest.fixture(scope='module')
def taught(drives) -> list[Any]:
    """Give what was said in a drive that began to learn in its 11th step, faster in its 21st."""
    controller = make_controller('rstdp', {'c_r': 90.0})
    host = ControllerHost(controller, SEED, controller.parameters)
    changes = {550_000_000: {'learning': True}, 1_050_000_000: {'c_r': 900.0}}
    seen, said = [], []
    with Simulator(SimulatorParameters.from_mapping({'robot.model': 'kinematic'})) as simulator:
        observation = simulator.reset(seed=SEED)
        for _ in range(60):
            if values := changes.get(observation.stamp_ns):
                host.changing.change(values)
            wheels = host.step(observation)
            seen.append(drives.seen(observation, wheels))
            observation = simulator.step(wheels)
    for each in drives.say(seen):
        stamp = each.fields.header.stamp
        stamp_ns = stamp.sec * 10**9 + stamp.nanosec
        if each.topic == '/wheel_velocities' and (values := changes.get(stamp_ns)):
            change = drives.change(stamp_ns, '/rstdp', **values)
            said.append(drives.said('/controller/parameter_changes', each.log_ns - 1, change))
        said.append(each)
    return said


FACTS = {'controller': 'rstdp', 'seed': str(SEED), 'parameters': '{"c_r": 90.0}'}


def test_changes_of_parameters_are_made_again(
    taught: list[Any], bag_of: BagOf, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where they took effect: every answer is the same; without them it is not."""
    bag = bag_of(taught, facts=FACTS)
    assert run(['replay', str(bag), '--json', '--out', str(tmp_path / 'again')]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result['agreement'], result['answers']) == (1.0, 60)
    assert result['notes'] == [
        'parameters of /rstdp were changed in the drive: learning = True from 0.55 s on; '
        'c_r = 900.0 from 1.05 s on',
        'the changes are made again where they took effect',
    ]
    given = ['--param', 'rstdp.learning=false', '--out', str(tmp_path / 'given')]
    assert run(['replay', str(bag), '--json', *given]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['agreement'] < 1.0
    assert 10 <= result['first_difference'] < 60
    assert result['notes'][1] == (
        'the changes are made again where they took effect, except those of rstdp.learning, '
        'which are given'
    )
    assert run(['replay', str(bag), '--json', '--controller', 'braitenberg', '--out',
                str(tmp_path / 'other')]) == 0  # fmt: skip
    result = json.loads(capsys.readouterr().out)
    assert result['notes'][1] == 'the changes are not made again: rstdp drove'


def test_a_change_whose_observation_is_missing_is_made_with_the_next(
    taught: list[Any], bag_of: BagOf
) -> None:
    """It would otherwise never be made."""
    packets = [each for each in taught if each.topic == '/event_camera/events']
    lost = [each for each in taught if each is not packets[10]]
    drive = RecordedDrive(bag_of(lost))
    (first, second) = drive.changes.controller
    assert first.change.values == {'learning': True}
    asked = Request('1', 'rstdp', SEED, parameters={'rstdp.c_r': 90.0})
    answers = {}
    for changes in ((first, second), ()):
        config = ReplayConfig.make(asked, drive.source.path)
        answers[len(changes)] = replay(config, drive, changes=changes).answers
    assert len(answers[2]) == 59
    assert answers[2] != answers[0]


def test_parameters_that_others_set_are_no_changes_of_a_drive(
    taught: list[Any], bag_of: BagOf, drives
) -> None:
    """The usual topic has the parameters of every node, with other stamps."""
    own = [each for each in taught if not each.topic.endswith('parameter_changes')]
    event = drives.change(10**18, '/rstdp', learning=True)
    drive = RecordedDrive(bag_of([drives.said('/parameter_events', own[0].log_ns, event), *own]))
    assert not any(drive.changes)
    assert drive.notes == []


def test_simulation_time_may_begin_again(drives, bag_of: BagOf) -> None:
    """Stamps repeat, so the messages recorded next to a packet belong to it."""
    seen = drives.drive('braitenberg', seed=SEED, episodes=(15, 25, 5), from_time_zero=True)
    result = replayed(bag_of(drives.say(seen)))
    assert (result['agreement'], result['steps']) == (1.0, 45)


def test_an_episode_may_begin_twice(drives, bag_of: BagOf, braitenberg_drive) -> None:
    """A simulator resets itself as it starts; the reset of the lap has the same number."""
    seen = [braitenberg_drive[0], *braitenberg_drive[:31]]
    first = seen[0].observation
    seen[0] = seen[0]._replace(observation=first._replace(stamp_ns=0))
    result = replayed(bag_of(drives.say(seen)))
    assert (result['agreement'], result['steps'], len(result['episodes'])) == (1.0, 30, 1)


# --- what bags are like ---------------------------------------------------------------------


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_one_file_is_as_good_as_its_folder(
    said: list[Any], bag_of: BagOf, compression: str
) -> None:
    """Compressed or not."""
    bag = bag_of(said, compression=compression)
    assert replayed(bag / 'bag_0.mcap') == replayed(bag)
    (bag / 'metadata.yaml').unlink()
    assert replayed(bag)['agreement'] == 1.0


@pytest.mark.parametrize(
    ('storage', 'mode'),
    [('sqlite3', ''), ('sqlite3', 'file'), ('sqlite3', 'message'), ('mcap', 'file')],
)
def test_storage_and_compression_change_nothing(
    drives, said: list[Any], tmp_path: Path, bag_of: BagOf, storage: str, mode: str
) -> None:
    """Those of rosbag2."""
    bag = drives.write_otherwise(tmp_path / 'bag', said, storage=storage, mode=mode)
    assert replayed(bag) == replayed(bag_of(said))
    if storage == 'sqlite3' and not mode:
        assert replayed(bag / 'bag.db3')['agreement'] == 1.0
        (bag / 'metadata.yaml').unlink()
        assert replayed(bag)['agreement'] == 1.0


def test_mono_is_as_good_as_evt3(drives, bag_of: BagOf, braitenberg_drive) -> None:
    """The same events."""
    assert replayed(bag_of(drives.say(braitenberg_drive, encoding='mono')))['agreement'] == 1.0


def test_topics_may_be_in_a_namespace(drives, bag_of: BagOf, braitenberg_drive) -> None:
    """The only one is found; of several, one has to be chosen."""
    left = drives.say(braitenberg_drive, prefix='/left/')
    right = drives.say(braitenberg_drive[:9], prefix='/right/')
    result = replayed(bag_of(left))
    assert (result['agreement'], result['answers']) == (1.0, OBSERVATIONS)
    both = bag_of(left + right)
    with pytest.raises(BagError, match=r'one topic of .*EventPacket.*, got /left/.*, '):
        replayed(both)
    chosen = replayed(both, events_topic='/right/event_camera/events')
    assert (chosen['agreement'], chosen['answers']) == (1.0, 9)


def test_topics_may_be_recorded_one_after_the_other(said: list[Any], bag_of: BagOf) -> None:
    """As a tool that sorts them leaves a bag: the stamps put them together."""
    result = replayed(bag_of(sorted(said, key=lambda each: each.topic)))
    assert (result['agreement'], result['notes']) == (1.0, [])


def test_packets_out_of_order_are_put_in_order(said: list[Any], bag_of: BagOf) -> None:
    """By their numbers, and that is said."""
    shuffled = [said[n] for n in np.random.default_rng(1).permutation(len(said))]
    result = replayed(bag_of(shuffled))
    assert (result['agreement'], result['answers']) == (1.0, OBSERVATIONS)
    assert result['notes'] == ['the event packets were out of order; taken by their numbers']


@pytest.mark.parametrize('is_overtaking', [False, True])
def test_a_camera_started_again_comes_after_what_it_saw_before(
    said: list[Any], bag_of: BagOf, is_overtaking: bool
) -> None:
    """Though its numbers are smaller then; only within either part packets are put in order."""
    numbers = [*range(5000, 5031), *range(OBSERVATIONS - 31)]
    renumbered = list(said)
    places = [n for n, each in enumerate(said) if each.topic == '/event_camera/events']
    for place, number in zip(places, numbers, strict=True):
        fields = dataclasses.replace(said[place].fields, seq=number)
        renumbered[place] = said[place]._replace(fields=fields)
    notes = []
    if is_overtaking:
        notes = ['the event packets were out of order; taken by their numbers']
        for one, other in ((places[4], places[5]), (places[50], places[52])):
            late, early = renumbered[one].fields, renumbered[other].fields
            renumbered[one] = renumbered[one]._replace(fields=early)
            renumbered[other] = renumbered[other]._replace(fields=late)
    result = replayed(bag_of(renumbered))
    assert (result['agreement'], result['answers']) == (1.0, OBSERVATIONS)
    assert result['notes'] == notes


def test_what_was_sent_twice_counts_once(said: list[Any], bag_of: BagOf) -> None:
    """As when somebody joins late."""
    result = replayed(bag_of([said[0], said[1], *said]))
    assert (result['agreement'], result['answers'], result['notes']) == (1.0, OBSERVATIONS, [])


def test_a_publisher_that_does_not_count_is_taken_as_recorded(
    drives, said: list[Any], bag_of: BagOf
) -> None:
    """All of its packets have number 0."""
    for each in said:
        if each.topic == '/event_camera/events':
            object.__setattr__(each.fields, 'seq', 0)
    try:
        assert replayed(bag_of(said))['agreement'] == 1.0
    finally:
        packets = [each for each in said if each.topic == '/event_camera/events']
        for number, each in enumerate(packets):
            object.__setattr__(each.fields, 'seq', 7 + number)


def test_a_gap_is_said_and_ends_with_the_episode(said: list[Any], bag_of: BagOf) -> None:
    """Answers before it agree, and those from the next reset on."""
    lost = [n for n, each in enumerate(said) if each.topic == '/event_camera/events'][10:13]
    result = replayed(bag_of([each for n, each in enumerate(said) if n not in lost]))
    assert result['notes'] == [
        '3 event packets are missing, the first after stamp 500000000 ns: answers after a gap '
        'may differ',
        '3 lane states lack their event packet',
    ]
    assert (result['packets'], result['lost_packets']) == (OBSERVATIONS - 3, 3)
    # The first episode has 31 observations: 10 before the gap and 18 after it.
    assert result['first_difference'] >= 10
    assert result['equal'] >= OBSERVATIONS - 31 + 10
    assert result['agreement'] < 1.0


def test_lost_answers_and_lane_states_are_said(said: list[Any], bag_of: BagOf) -> None:
    """What is left agrees."""
    lanes = [n for n, each in enumerate(said) if each.topic == '/lane/state'][5:7]
    wheels = [n for n, each in enumerate(said) if each.topic == '/wheel_velocities'][:4]
    left = [each for n, each in enumerate(said) if n not in lanes + wheels]
    result = replayed(bag_of(left))
    assert (result['agreement'], result['answers']) == (1.0, OBSERVATIONS - 4)
    assert result['unanswered'] == 4
    assert result['notes'] == ['2 event packets lack their lane state']
    assert result['steps'] == 75 - 2


def test_without_lane_states_there_is_one_episode(drives, bag_of: BagOf) -> None:
    """As for a node that knows no lane; and no distances."""
    seen = drives.drive('braitenberg', seed=1, episodes=(30,))
    bag = bag_of(without(drives.say(seen), '/lane/state'))
    result = replayed(bag, seed=1)
    assert result['agreement'] < 1.0
    assert (result['steps'], result['source']) == (31, 'simulator')
    assert (result['mean_abs_distance_m'], result['episodes']) == (None, [])
    assert result['notes'] == ['no /lane/state: one episode, distances unknown']
    whole = replayed(bag_of(drives.say(seen)), seed=1, use_lane_state=False)
    assert (whole['equal'], whole['steps']) == (result['equal'], 30)
    assert whole['mean_abs_distance_m'] > 0


def test_without_answers_nothing_is_compared(said: list[Any], bag_of: BagOf) -> None:
    """Agreement is not known, distances are."""
    result = replayed(bag_of(without(said, '/wheel_velocities')))
    assert (result['agreement'], result['answers']) == (None, 0)
    assert result['first_difference'] is None
    assert result['mean_abs_distance_m'] > 0
    assert result['notes'] == ['no /wheel_velocities: nothing to compare with']


def test_without_events_there_is_nothing_to_replay(said: list[Any], bag_of: BagOf) -> None:
    """The message has the topics there are."""
    bag = bag_of(without(said, '/event_camera/events'))
    only = r'only /lane/state \(spikelane_msgs/msg/LaneState\), /wheel_velocities \(.*\)$'
    with pytest.raises(BagError, match=f'got none, {only}'):
        replayed(bag)
    with pytest.raises(BagError, match=r'expected /cam with messages, got /event_camera/events$'):
        replayed(bag_of(said), events_topic='/cam')


@pytest.mark.parametrize('part', [0.3, 0.6])
def test_of_a_cut_file_what_is_there_is_replayed(
    said: list[Any], bag_of: BagOf, part: float
) -> None:
    """And that it was cut is said."""
    file = bag_of(said) / 'bag_0.mcap'
    content = file.read_bytes()
    file.write_bytes(content[: int(part * len(content))])
    result = replayed(file)
    assert result['agreement'] == 1.0
    assert 5 < result['answers'] < OBSERVATIONS
    assert any('was cut or never closed' in note for note in result['notes'])


def test_a_damaged_chunk_is_a_gap(said: list[Any], bag_of: BagOf) -> None:
    """Said as such."""
    file = bag_of(said, compression='none') / 'bag_0.mcap'
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0xFF
    file.write_bytes(content)
    result = replayed(file)
    assert any('is damaged and was left out' in note for note in result['notes'])
    assert result['answers'] < OBSERVATIONS


def test_a_cut_database_is_one_sentence(drives, said: list[Any], tmp_path: Path) -> None:
    """SQLite cannot read half of it."""
    bag = drives.write_otherwise(tmp_path / 'bag', said, storage='sqlite3')
    content = (bag / 'bag.db3').read_bytes()
    (bag / 'bag.db3').write_bytes(content[: len(content) // 2])
    try:
        notes = replayed(bag)['notes']
    except BagError as error:
        notes = [str(error)]
    assert any('cannot be read any further' in note for note in notes)
    assert all('\n' not in note for note in notes)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_damage_anywhere_is_said_in_single_lines(
    drives, said: list[Any], tmp_path: Path, storage: str
) -> None:
    """As a refusal or as notes; never as another error."""
    bag = drives.write_otherwise(tmp_path / 'bag', said, storage=storage)
    (file,) = (path for path in bag.iterdir() if path.suffix != '.yaml')
    content = np.frombuffer(file.read_bytes(), np.uint8)
    rng = np.random.default_rng(1)
    refused = 0
    for count in (1, 5, 50) * 5:
        damaged = content.copy()
        damaged[rng.integers(0, len(content), count)] = rng.integers(0, 256, count)
        file.write_bytes(damaged[: len(content) - rng.integers(0, len(content) // 2)].tobytes())
        try:
            lines = replayed(bag)['notes']
        except BagError as error:
            refused += 1
            lines = [str(error)]
        assert lines
        assert not any('\n' in line for line in lines)
    assert refused > 0


def test_a_bag_may_be_in_several_files(drives, said: list[Any], tmp_path: Path) -> None:
    """As with a largest size for each."""
    drives.write(tmp_path / 'bag', said, max_file_bytes=12_000)
    assert len(list((tmp_path / 'bag').glob('*.mcap'))) > 1
    result = replayed(tmp_path / 'bag')
    assert (result['agreement'], result['answers']) == (1.0, OBSERVATIONS)


def test_another_encoding_is_refused_with_those_allowed(said: list[Any], bag_of: BagOf) -> None:
    """By the first packet; a later one that cannot be decoded is one without events."""
    packets = [each.fields for each in said if each.topic == '/event_camera/events']
    object.__setattr__(packets[0], 'encoding', 'evt2')
    try:
        with pytest.raises(BagError, match=r"one of evt3, mono, libcaer, libcaer_cmp, got 'evt2'"):
            replayed(bag_of(said))
        object.__setattr__(packets[0], 'encoding', 'evt3')
        object.__setattr__(packets[12], 'encoding', 'evt2')
        result = replayed(bag_of(said))
        (note,) = result['notes']
        assert note.startswith('1 event packets cannot be decoded; taken as empty: event p')
        assert note.endswith("got 'evt2'")
        assert result['faulty_packets'] == 1
    finally:
        for each in packets:
            object.__setattr__(each, 'encoding', 'evt3')


@pytest.mark.parametrize(
    ('make', 'message'),
    [
        (lambda path: None, 'expected an .mcap or .db3 file or a bag folder, found nothing'),
        (lambda path: path.mkdir(), 'expected .mcap or .db3 files, found none'),
        (
            lambda path: path.write_text('text'),
            "a bag folder, got a file that begins with b'text'",
        ),
    ],
)
def test_what_is_no_bag_is_refused(
    tmp_path: Path, make: Callable[[Path], Any], message: str
) -> None:
    """In one sentence."""
    make(tmp_path / 'bag')
    with pytest.raises(BagError, match=re.escape(message)):
        RecordedDrive(tmp_path / 'bag')


# --- bags of others -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('name', 'packets', 'counts'),
    [
        ('bag_none', 98, {'on': 5496, 'off': 5643, 'sum_x': 719005, 'sum_y': 602957}),
        ('bag_zstd', 91, {'on': 5086, 'off': 5212, 'sum_x': 664087, 'sum_y': 555322}),
    ],
)
@pytest.mark.parametrize('file', ['', '{}_0.mcap'])
def test_bags_of_ros2_bag_record_are_read(
    name: str, packets: int, counts: dict[str, int], file: str
) -> None:
    """Whose definitions are in IDL; the events are those that event_camera_codecs counts."""
    result = replayed(DATA / name / file.format(name))
    assert result['packets'] == packets
    assert counts.items() <= result['events'].items()
    assert result['agreement'] is None


@pytest.mark.parametrize('controller', ['braitenberg', 'rstdp'])
@pytest.mark.parametrize(
    ('name', 'packets', 'counts', 'steps'),
    [
        (
            'test_data_evt3_trigger',
            105,
            {'on': 41439, 'off': 41030, 'sum_x': 42078718, 'sum_y': 31656267},
            25,
        ),
        (
            'test_data_libcaer_rollover',
            201,
            {'on': 181908, 'off': 152423, 'sum_x': 111651612, 'sum_y': 82801007},
            39,
        ),
    ],
)
def test_real_cameras_are_answered_in_real_time(
    controller: str, name: str, packets: int, counts: dict[str, int], steps: int
) -> None:
    """1280 x 720 in evt3 and 640 x 480 in libcaer, both SQLite, by each controller."""
    if not CAMERAS.is_dir():
        pytest.skip(f'no recordings of cameras at {CAMERAS}')
    bag = CAMERAS / name
    drive = RecordedDrive(bag)
    result = replay(ReplayConfig.make(Request('1', controller, parameters={}), bag), drive)
    told = summarise(drive, result.answers, result.sensor)
    assert (told['packets'], told['steps'], told['source']) == (packets, steps, 'camera')
    assert counts.items() <= told['events'].items()
    assert (told['agreement'], told['lost_packets'], told['faulty_packets']) == (None, 0, 0)
    wheels = [each.replayed for each in result.answers]
    assert all(math.isfinite(value) for pair in wheels for value in pair)
    assert len({pair.left for pair in wheels}) > 5
    assert result.processing_s < told['duration_s']


def camera_drive(drives: Any) -> list[Any]:
    """Return packets of 13 ms from a camera, a second in all, of chance events."""
    rng = np.random.default_rng(4)
    said = []
    for number in range(77):
        begin_ns = 10**9 + number * 13_000_000
        t_ns = np.sort(begin_ns + rng.integers(0, 13_000, 200) * 1000)
        x, y = rng.integers(0, 128, (2, 200))
        events = make_events(t_ns, x, y, rng.choice([-1, 1], 200))
        packet = drives.packet(events, begin_ns + 13_000_000, number, 'mono')
        object.__setattr__(packet, 'header', drives.header(2 * 10**9 + number * 13_000_000))
        said.append(drives.said('/event_camera/events', number * 13_000_000, packet))
    return said


def test_a_real_cameras_answers_are_compared_too(drives, bag_of: BagOf) -> None:
    """They carry the ends of steps of 50 ms for their stamps."""
    said = camera_drive(drives)
    bag = bag_of(said)
    answers = replay(
        ReplayConfig.make(Request('1', 'braitenberg', 1, parameters={}), bag), RecordedDrive(bag)
    ).answers
    # The first event is in the first ms; 1.001 s have 20 steps, the last one not complete.
    assert len(answers) in (19, 20)
    first_ns = 2 * 10**9
    assert [each.stamp_ns - first_ns for each in answers] == [
        50_000_000 * (n + 1) for n in range(len(answers))
    ]
    for each in answers:
        wheels = drives.wheels(each.stamp_ns, each.replayed)
        said.append(drives.said('/wheel_velocities', each.stamp_ns - first_ns, wheels))
    bag = bag_of(said)
    result = replayed(bag, seed=1)
    assert (result['agreement'], result['answers']) == (1.0, len(answers))
    assert (result['source'], result['packets']) == ('camera', 77)
    assert replayed(bag, seed=2)['agreement'] < 1.0


# --- the pieces -----------------------------------------------------------------------------


def test_nothing_is_measured_of_nothing() -> None:
    """No answers, no lane states."""
    assert compare([])['agreement'] is None
    assert drive_metrics([])['steps'] == 0


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ({'parameters': {'simulator.x': 1}}, 'expected braitenberg.<name> or sensor.<name>'),
        ({'parameters': {'sensor.zoom': 2}}, "sensor: unknown parameter 'zoom'; expected source"),
        ({'seed': -1}, 'seed: expected a whole number'),
        ({'parameters': {'sensor.source': 'eye'}}, 'expected one of auto, simulator, camera'),
    ],
)
def test_wrong_parameters_are_refused(arguments: dict[str, Any], message: str) -> None:
    """Before anything is replayed."""
    with pytest.raises(ParameterError, match=message):
        ReplayConfig.make(Request('1', 'braitenberg', **arguments), Path('bag'))


# --- the command ----------------------------------------------------------------------------


def test_the_command_leaves_a_folder(
    said: list[Any], bag_of: BagOf, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Controller, seed and scenario are those that the bag gives."""
    facts = {'seed': str(SEED), 'controller': 'braitenberg', 'scenario': '1'}
    bag = bag_of(said, facts=facts)
    assert run(['replay', str(bag), '--json', '--out', str(tmp_path / 'out')]) == 0
    out, err = capsys.readouterr()
    assert (out.count('\n'), err) == (1, '')
    result = json.loads(out)
    assert (result['agreement'], result['first_difference']) == (1.0, None)
    assert (result['controller'], result['seed'], result['steps']) == ('braitenberg', SEED, 75)
    assert json.loads((tmp_path / 'out/metrics.json').read_text()) == result
    files = {str(p.relative_to(tmp_path / 'out')) for p in (tmp_path / 'out').rglob('*.*')}
    assert files == {
        'config.yaml',
        'answers.csv',
        'metrics.json',
        'figures/replay.svg',
        'figures/replay.png',
    }
    rows = list(csv.DictReader((tmp_path / 'out/answers.csv').open()))
    assert len(rows) == OBSERVATIONS
    assert rows[20]['recorded_left_rad_s'] == rows[20]['replayed_left_rad_s'] != ''
    assert [rows[n]['episode'] for n in (30, 31)] == ['1', '2']


def test_the_parameters_in_the_bag_are_taken(
    drives, bag_of: BagOf, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The controller that drove gets them, unless others are given; other controllers do not."""
    parameters = {'checkpoint': 'scenario_2', 'steering.v_max': 1.25}
    seen = drives.drive('rstdp', seed=2, episodes=(30,), parameters=parameters)
    facts = {'seed': '2', 'controller': 'rstdp', 'scenario': 'course.yaml'}
    facts['parameters'] = json.dumps({**parameters, 'gone': 1})
    bag = bag_of(drives.say(seen), facts=facts)
    agreements = []
    for number, given in enumerate(
        (
            (),
            ('--scenario', '2'),
            ('--scenario', '1'),
            ('--param', 'rstdp.steering.v_max=1.5'),
            ('--checkpoint', 'scenario_1'),
            ('--controller', 'braitenberg'),
        )
    ):
        out = str(tmp_path / str(number))
        assert run(['replay', str(bag), '--json', '--out', out, *given]) == 0
        agreements.append(json.loads(capsys.readouterr().out)['agreement'])
    assert agreements[:2] == [1.0, 1.0]
    assert all(each < 1.0 for each in agreements[2:])


def test_the_command_speaks_to_people(
    said: list[Any], bag_of: BagOf, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line each; also of what is missing."""
    bag = bag_of(without(said, '/wheel_velocities'))
    arguments = ['replay', str(bag), '--controller', 'rstdp', '--out', str(tmp_path / 'out')]
    assert run(arguments) == 0
    out, _ = capsys.readouterr()
    assert out.startswith('steps           75, 78 observations\nagreement       unknown: ')
    assert out.endswith('note            no /wheel_velocities: nothing to compare with\n')


def test_the_state_messages_name_the_controller_that_drove(
    drives: Any, said: list[Any], bag_of: BagOf, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another program may have left out the bag's metadata; the seed is unknown then."""
    first = said[0]
    state = drives.controller_state(50_000_000, 'braitenberg')
    bag = bag_of([type(first)('/controller/state', first.log_ns, state), *said])
    assert run(['replay', str(bag), '--json', '--out', str(tmp_path / 'out')]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result['controller'], result['seed']) == ('braitenberg', 0)
    assert any('does not say the seed' in note for note in result['notes'])


@pytest.mark.parametrize(
    ('arguments', 'status', 'error'),
    [
        ((), 2, '--controller: expected one of braitenberg, .* bag does not say what drove'),
        (('--controller', 'rstdp', '--param', 'x'), 2, "--param: expected NAME=VALUE, got 'x'"),
        (('--controller', 'braitenberg', '--checkpoint', 'a'), 2, '--checkpoint: expected a cont'),
        (('--controller', 'braitenberg', '--scenario', '9'), 2, 'course: expected scenario_1'),
        (('--controller', 'braitenberg', '--events', '/e'), 1, '.*expected /e with messages'),
    ],
)
def test_wrong_use_is_one_line(
    said: list[Any],
    bag_of: BagOf,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    status: int,
    error: str,
) -> None:
    """And leaves nothing."""
    bag = bag_of(said[:9])
    assert run(['replay', str(bag), '--out', str(tmp_path / 'out'), *arguments]) == status
    out, err = capsys.readouterr()
    assert (out, err.count('\n')) == ('', 1)
    assert re.match(f'spikelane replay: {error}', err)
    assert not (tmp_path / 'out').exists()
