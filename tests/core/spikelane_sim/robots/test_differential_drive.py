"""What wheel velocities mean for the body, and what a URDF says of the wheels."""

import pytest

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.robots import make_robot, RobotParameters
from spikelane_sim.robots.differential_drive import BodyVelocity, DriveGeometry, read_geometry
from spikelane_sim.robots.registry import robot_model

JOINTS = ('left_wheel_joint', 'right_wheel_joint')
#: A footprint, wheels on arms that are turned, and joints and links in another order.
NESTED = """
<robot name="nested">
  <joint name="r" type="continuous">
    <parent link="right_arm"/><child link="r_wheel"/><origin xyz="0 0 0.1" rpy="-1.5707963 0 0"/>
  </joint>
  <joint name="l" type="continuous">
    <parent link="left_arm"/><child link="l_wheel"/><origin xyz="0 0 0.1"/>
  </joint>
  <joint name="left_mount" type="fixed">
    <parent link="base_link"/><child link="left_arm"/>
    <origin xyz="0.1 0.1 0" rpy="-1.5707963 0 0"/>
  </joint>
  <joint name="right_mount" type="fixed">
    <parent link="base_link"/><child link="right_arm"/>
    <origin xyz="0.1 -0.1 0" rpy="1.5707963 0 0"/>
  </joint>
  <joint name="base" type="fixed">
    <parent link="base_footprint"/><child link="base_link"/><origin xyz="0 0 0.2"/>
  </joint>
  <link name="l_wheel">
    <collision><geometry><mesh filename="w"/></geometry></collision>
    <visual><geometry><cylinder radius="0.05" length="0.02"/></geometry></visual>
  </link>
  <link name="r_wheel">
    <collision><geometry><sphere radius="0.05"/></geometry></collision>
    <visual><geometry><cylinder radius="0.06" length="0.02"/></geometry></visual>
  </link>
</robot>
"""


def test_body_velocity_has_the_signs_of_rep_103() -> None:
    """Forward is positive, and so is a turn to the left, for which the right wheel is faster."""
    geometry = DriveGeometry(wheel_radius_m=0.1, track_m=0.5)
    assert geometry.body_velocity(WheelVelocities(2.0, 2.0)) == pytest.approx((0.2, 0.0))
    assert geometry.body_velocity(WheelVelocities(1.0, 2.0)) == pytest.approx((0.15, 0.2))
    assert geometry.body_velocity(WheelVelocities(2.0, -2.0)) == pytest.approx((0.0, -0.8))


def test_body_velocity_is_that_of_the_simulated_robot() -> None:
    """The ideal drive's own state, in the frame of the axle."""
    parameters = RobotParameters.from_mapping({'engine': 'kinematic', 'model': 'turtlebot4'})
    robot = make_robot(parameters)
    wheels = WheelVelocities(1.5, 2.5)
    robot.step(wheels)
    geometry = DriveGeometry(parameters.wheel_radius_m, parameters.track_m)
    velocity = geometry.body_velocity(wheels)
    assert velocity.forward_m_s == pytest.approx(robot.state.linear[0], rel=1e-12)
    assert velocity.turn_rad_s == pytest.approx(robot.state.angular[2], rel=1e-12)


@pytest.mark.parametrize(
    ('wanted', 'limited'),
    [
        ((0.4, -0.8), (0.4, -0.8)),
        ((1.0, 0.8), (0.5, 0.4)),  # half as fast on the same path
        ((-1.0, 0.0), (-0.5, 0.0)),
        ((0.4, -4.0), (0.1, -1.0)),
        ((2.0, 2.0), (0.5, 0.5)),  # both too fast: the slower share counts
        ((0.0, 0.0), (0.0, 0.0)),
    ],
)
def test_limits_keep_the_path(wanted: tuple[float, float], limited: tuple[float, float]) -> None:
    """Velocity and turning rate are slowed down alike."""
    assert BodyVelocity(*wanted).limited(0.5, 1.0) == pytest.approx(limited)


def test_a_limit_of_zero_stops_the_robot() -> None:
    """As nothing else is within it."""
    assert BodyVelocity(1.0, 0.5).limited(0.0, 1.0) == (0.0, 0.0)


@pytest.mark.parametrize(
    ('name', 'radius_m', 'track_m'), [('p3dx', 0.0975, 0.331), ('turtlebot4', 0.03575, 0.233)]
)
def test_our_robots_urdfs_say_it(name: str, radius_m: float, track_m: float) -> None:
    """The radius and the track that docs/robots.md gives."""
    urdf = robot_model(name).urdf.read_text(encoding='utf-8')
    assert read_geometry(urdf, *JOINTS) == pytest.approx((radius_m, track_m))


def test_wheels_are_found_through_frames_between() -> None:
    """0.1 m to each arm and 0.1 m along it; what a wheel collides with comes before its looks."""
    assert read_geometry(NESTED, 'l', 'r') == pytest.approx((0.05, 0.4))


@pytest.mark.parametrize(
    ('urdf', 'joints', 'message'),
    [
        ('no XML', ('l', 'r'), "expected XML, got 'no XML'"),
        ('<robot/>', ('l', 'r'), 'expected a joint l, got none'),
        (
            NESTED,
            ('l', 'right'),
            'a joint right, got r, l, left_mount, right_mount, base',
        ),
        (NESTED, ('r', 'l'), 'expected r to the left of l, got it 0.4 m to the right'),
        (NESTED.replace('sphere', 'mesh').replace('radius="0.06"', ''), ('l', 'r'), "got ''"),
        (NESTED.replace('cylinder', 'mesh'), ('l', 'r'), 'l_wheel to be a cylinder or a sphere'),
        (NESTED.replace('sphere radius="0.05"', 'sphere radius="0.07"'), ('l', 'r'), 'one radius'),
        (
            NESTED.replace('radius="0.05"', 'radius="-1"'),
            ('l', 'r'),
            'a radius, got -1 m',
        ),
        (NESTED.replace('0.1 0.1 0', '0.1 nan 0'), ('l', 'r'), "3 numbers, got '0.1 nan 0'"),
        (NESTED.replace('base_footprint', 'l_wheel'), ('l', 'r'), 'joint l above itself'),
    ],
)
def test_a_urdf_that_does_not_say_it_is_refused(
    urdf: str, joints: tuple[str, str], message: str
) -> None:
    """With what is wrong."""
    with pytest.raises(ParameterError, match='URDF: ') as caught:
        read_geometry(urdf, *joints)
    assert message in str(caught.value)
