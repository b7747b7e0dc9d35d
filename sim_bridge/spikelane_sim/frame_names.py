"""Names of joints and frames that the robot's URDF, messages and nodes share."""

#: Names of the wheels' joints, left and right.
WHEEL_JOINTS = ('left_wheel_joint', 'right_wheel_joint')
#: The frame whose z points where the camera looks, and x to the right of the image (REP 103).
CAMERA_FRAME = 'event_camera_optical_frame'
