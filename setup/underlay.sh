# ROS without our workspace; sourced by env.sh, and to build the workspace.
_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
_venv=$_root/.venv

# Put a path at the beginning of a variable that is a list of paths, once.
_prepend() {
  case ":${!1:-}:" in
    *":$2:"*) ;;
    *) export "$1=$2${!1:+:${!1}}" ;;
  esac
}

export VIRTUAL_ENV=$_venv
_prepend PATH "$_venv/bin"

# Where no ROS is installed it comes from wheels in .venv, whose libraries the loader must find.
if [ -d "$_venv/share/rclpy" ]; then
  # Another ROS that happens to be sourced would be found before the wheels'.
  case "${AMENT_PREFIX_PATH:-}" in
    '' | *"$_venv"*) ;;
    *) unset AMENT_PREFIX_PATH CMAKE_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH ;;
  esac
  _prepend AMENT_PREFIX_PATH "$_venv"
  _prepend CMAKE_PREFIX_PATH "$_venv"
  for _path in "$_venv"/lib/python3.*/site-packages/ros_*.libs "$_venv/lib"; do
    _prepend LD_LIBRARY_PATH "$_path"
  done
  # The wheels otherwise start Python a second time, to set the path just set.
  export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
  export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3
  export RMW_IMPLEMENTATION=rmw_fastrtps_cpp
fi
unset _root _venv _path
