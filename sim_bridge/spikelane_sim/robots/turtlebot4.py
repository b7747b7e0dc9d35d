"""The TurtleBot 4 (standard), on the base iRobot Create 3; sources of masses are in its URDF."""

from pathlib import Path

from spikelane_sim.robots.model import RobotModel

TURTLEBOT4 = RobotModel(
    'TurtleBot 4',
    'turtlebot4',
    Path(__file__).with_name('turtlebot4.urdf'),
    drive={
        # iRobotEducation/create3_sim, irobot_create_control: wheel_radius and wheel_separation.
        'wheel_radius_m': 0.03575,
        'track_m': 0.233,
        # There base_link lies on the floor, below the middle of the axle.
        'axle_x_m': 0.0,
        'height_m': 0.0,
        # At most 0.306 m/s in safe mode, as the robot comes (there, and in the TurtleBot 4 user
        # manual, "Features"): 0.306 m/s / 0.03575 m. Without safe mode 0.46 m/s, 12.87 rad/s.
        'max_wheel_velocity_rad_s': 8.56,
        # Ours. A motor as small as this is felt at its wheel as some times the wheel itself, which
        # has 0.00013 kg m^2; the torque then accelerates all of the 3.945 kg by the base's limit
        # of 0.9 m/s^2 (irobot_create_control: linear.x.max_acceleration).
        'rotor_inertia_kg_m2': 0.0005,
        'wheel_torque_n_m': 0.079,
    },
    # Ours: at the front edge of the base, as high above the floor as the paper's camera is and
    # with its pitch. The robot's own camera sits behind the axle, where the robot hides the road.
    camera={'x_m': 0.164, 'y_m': 0.0, 'z_m': 0.2558},
)
