# The environment in which Spikelane runs. In bash: source setup/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/underlay.sh"
_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)

# With it nodes find each other in half a second instead of three. A profile of yours is kept.
if [ -z "${FASTRTPS_DEFAULT_PROFILES_FILE:-}" ]; then
  export FASTRTPS_DEFAULT_PROFILES_FILE=$_root/ros2_ws/src/spikelane/config/fastdds.xml
fi

# Where Python is kept from writing bytecode, every node would compile all libraries at each start,
# for a second and more: it is written after all, but not beside any source.
if [ -n "${PYTHONDONTWRITEBYTECODE:-}" ]; then
  unset PYTHONDONTWRITEBYTECODE
  export PYTHONPYCACHEPREFIX=${PYTHONPYCACHEPREFIX:-$_root/.venv/pycache}
fi

# What ros2_ws/install/local_setup.bash does, but in no time, and in paths with spaces too.
for _prefix in "$_root"/ros2_ws/install "$_root"/ros2_ws/install/*; do
  if [ -d "$_prefix/share/ament_index" ]; then
    _prepend AMENT_PREFIX_PATH "$_prefix"
    _prepend LD_LIBRARY_PATH "$_prefix/lib"
    for _path in "$_prefix"/lib/python3.*/site-packages; do
      _prepend PYTHONPATH "$_path"
    done
  fi
done
# Python packages are linked: their modules and entry points are found by way of build/.
for _path in "$_root"/ros2_ws/build/*/*.egg-info; do
  _prepend PYTHONPATH "${_path%/*}"
done

# Numba does not notice when a kernel changes that another file's kernel has taken in: compiled
# kernels are kept by the text of all of them.
_kernels=$(cd "$_root" && grep -rl --include='*.py' njit sim_bridge controllers | sort | xargs cat | cksum)
export NUMBA_CACHE_DIR=$_root/.venv/numba/${_kernels// /-}
unset _root _prefix _path _kernels
unset -f _prepend
