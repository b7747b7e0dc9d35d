# The environment in which Spikelane runs. In bash: source setup/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/underlay.sh"
_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)

# With this profile nodes find each other in half a second instead of three, and use the loopback
# interface alone, or all interfaces with SPIKELANE_NETWORK=all. A profile of yours is kept. The
# nodes do the same themselves where this file is not sourced (spikelane_sim/nodes/network.py).
case "${FASTRTPS_DEFAULT_PROFILES_FILE:-}" in
  '' | */spikelane_loopback.xml | */spikelane_all.xml)
    _profile=spikelane_${SPIKELANE_NETWORK:-loopback}.xml
    export FASTRTPS_DEFAULT_PROFILES_FILE=$_root/sim_bridge/spikelane_sim/nodes/fastdds/$_profile
    ;;
esac

# Where Python is kept from writing bytecode, every node would compile all libraries at each start,
# for a second and more: it is written after all, but not next to any source.
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
_kernels=$(cd "$_root" && grep -rlE --include='*.py' 'numba|spikelane_sim.compiled' sim_bridge controllers | sort | xargs cat | cksum)
export NUMBA_CACHE_DIR=$_root/.venv/numba/${_kernels// /-}
unset _root _profile _prefix _path _kernels
unset -f _prepend
