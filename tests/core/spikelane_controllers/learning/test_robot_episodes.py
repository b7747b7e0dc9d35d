"""Episodes of a robot that a person puts back."""

import math

import pytest

from spikelane_controllers.learning.robot_episodes import EpisodeError, RobotEpisodes
from spikelane_sim.contract import LaneState

STATE = LaneState('inner', 0.05, 0.1, 7.0, 'C', 3.0, 1, 99, 77, True, 'lane_lost')


def test_nothing_is_driven_before_a_person_begins() -> None:
    """Wherever the robot is."""
    episodes = RobotEpisodes(0.2)
    episodes.hear_distance('lane', 0.0)
    assert episodes.next() is None


def test_steps_of_an_episode_are_counted_from_zero() -> None:
    """Episodes from one, or from where a training was resumed."""
    episodes = RobotEpisodes(0.2, first_episode=4)
    episodes.hear_distance('lane', 0.1)
    assert episodes.begin() == (4, None)
    states = [episodes.next() for _ in range(3)]
    assert [(each.episode, each.step) for each in states if each] == [(4, 0), (4, 1), (4, 2)]
    assert {each.distance_m for each in states if each} == {0.1}
    assert {each.lane for each in states if each} == {'lane'}


def test_a_state_keeps_the_place_and_gets_the_robots_own_episode() -> None:
    """The source's episode, step and end are somebody else's."""
    episodes = RobotEpisodes(0.2)
    episodes.hear(STATE)
    episodes.begin()
    assert episodes.next() == STATE._replace(episode=1, step=0, terminated=False, reason='')


@pytest.mark.parametrize('distance_m', [0.21, -0.21])
def test_a_lost_lane_ends_the_episode_until_the_robot_is_put_back(distance_m: float) -> None:
    """On either side; too far away none begins."""
    episodes = RobotEpisodes(0.2)
    episodes.hear_distance('lane', 0.0)
    episodes.begin()
    episodes.next()
    episodes.hear_distance('lane', distance_m)
    last = episodes.next()
    assert last is not None
    assert (last.terminated, last.reason, last.step) == (True, 'lane_lost', 1)
    assert episodes.next() is None
    with pytest.raises(EpisodeError, match=r'at most 0\.2 m from the lane.s centre, got -?0\.21'):
        episodes.begin()
    episodes.hear_distance('lane', 0.02)
    assert episodes.next() is None
    assert episodes.begin() == (2, None)
    assert episodes.next() is not None


def test_a_person_can_end_an_episode_that_runs() -> None:
    """With its last step: where the robot is carried to is none."""
    episodes = RobotEpisodes(0.2)
    episodes.hear_distance('lane', 0.15)
    episodes.begin()
    episodes.next()
    last = episodes.next()
    assert last is not None
    episodes.hear_distance('lane', 0.01)
    assert episodes.begin() == (2, last._replace(terminated=True, reason='put_back'))
    assert episodes.begin() == (3, None)


def test_an_episode_does_not_begin_where_the_robot_is_not_known_to_be() -> None:
    """A distance that is not finite is none."""
    episodes = RobotEpisodes(0.2)
    for number in (math.nan, math.inf):
        with pytest.raises(EpisodeError, match='lane distance: expected a finite number'):
            episodes.hear_distance('lane', number)
    with pytest.raises(EpisodeError, match='expected one to begin an episode, got none yet'):
        episodes.begin()
