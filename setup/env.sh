# The environment in which Spikelane runs; in bash: source setup/env.sh
# Where no ROS is installed, ROS comes from wheels in .venv, whose libraries the loader must find.
_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
_venv=$_root/.venv

export VIRTUAL_ENV=$_venv
case ":$PATH:" in *":$_venv/bin:"*) ;; *) export PATH=$_venv/bin:$PATH ;; esac

if [ -d "$_venv/share/rclpy" ]; then
  _libs=$_venv/lib$(printf ':%s' "$_venv"/lib/python3.*/site-packages/ros_*.libs)
  case ":$LD_LIBRARY_PATH:" in
    *":$_libs:"*) ;;
    *) export LD_LIBRARY_PATH=$_libs${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH} ;;
  esac
  # The libraries are found: keep the wheels from starting Python a second time to find them.
  export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
  export AMENT_PREFIX_PATH=$_venv CMAKE_PREFIX_PATH=$_venv
  export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3
  export RMW_IMPLEMENTATION=rmw_fastrtps_cpp
  unset _libs
fi

_profile=$_root/ros2_ws/src/spikelane/config/fastdds.xml
if [ -z "${FASTRTPS_DEFAULT_PROFILES_FILE:-}" ] && [ -f "$_profile" ]; then
  export FASTRTPS_DEFAULT_PROFILES_FILE=$_profile
fi

[ ! -f "$_root/ros2_ws/install/local_setup.bash" ] || . "$_root/ros2_ws/install/local_setup.bash"
unset _root _venv _profile
