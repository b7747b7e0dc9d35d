"""The names of all topics, relative where a namespace or a remapping may change them."""

EVENTS = 'event_camera/events'
CAMERA_INFO = 'event_camera/camera_info'
IMAGE = 'event_camera/image_raw'

LANE_STATE = 'lane/state'
LANE_DISTANCE = 'lane/distance'
ODOMETRY = 'ground_truth/odom'
#: Where a real robot takes itself to be.
ROBOT_ODOMETRY = 'odometry'
JOINT_STATES = 'joint_states'
ROBOT_DESCRIPTION = 'robot_description'

WHEELS = 'wheel_velocities'
#: What else drives the robot: a wheel controller's array, and a twist.
WHEEL_ARRAY = 'wheel_velocity_controller/commands'
TWIST = 'cmd_vel'

#: Dead-man switches: a joystick, or true while the robot may drive.
JOYSTICK = 'joy'
DEAD_MAN = 'dead_man_switch'

CONTROLLER_STATE = 'controller/state'
WEIGHTS = 'controller/weights'
#: What a controller records of itself, where it is asked to.
RECORDED = 'controller/recorded'

#: Changes of parameters while a drive goes on, by who has them.
SIMULATOR_CHANGES = 'simulator/parameter_changes'
CONTROLLER_CHANGES = 'controller/parameter_changes'

#: How publishers and the recorder meet, see `spikelane_sim.nodes.meeting`.
RECORDER_STATE = 'recorder/state'
PUBLISHED = 'recorder/published'

#: These are the same in every namespace.
CLOCK = '/clock'
TF = '/tf'
TF_STATIC = '/tf_static'
DIAGNOSTICS = '/diagnostics'
