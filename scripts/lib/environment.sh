# Set-up, build and environment for the commands in scripts/. Sourced, not run.
#
#   gsv_setup [section...]   installs missing packages of packages.txt: [run], [build], these sections
#   gsv_build [target...]    configures and builds in $gsv_build_folder; without a target: everything
#   gsv_env                  sets the environment of ROS and of this build in the calling shell
#   gsv_command NAME ARG...  runs NAME.py of this folder, which does set-up and build
#   gsv_python COMMAND...    runs `ground_scale_vo COMMAND...` of the Python module, after set-up and build
#   gsv_use_build FOLDER     builds in FOLDER from now on, also in a catkin workspace
#   $gsv_cmake_arguments     array of further arguments of cmake for gsv_build
#   $gsv_tools               the folder of the package's executables
#   $gsv_build_folder        <root>/build unless GROUND_SCALE_VO_BUILD or gsv_use_build names another one
#
# gsv_build does nothing in a catkin workspace whose devel space is sourced, which is used then, and in an
# install space, where the commands are in <prefix>/lib/ground_scale_vo and gsv_root is <prefix>/lib. A
# function that fails returns non-zero and prints a sentence, those that call apt or cmake with an excerpt
# of their log.

unset CDPATH # with it, cd prints the folder
gsv_lib=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
gsv_root=$(cd "$gsv_lib/../.." && pwd)
gsv_installed() { [[ ! -f $gsv_root/CMakeLists.txt ]]; }
gsv_use_build() {
  gsv_build_folder=$1
  gsv_space=${2:-$gsv_build_folder/devel}
  if gsv_installed; then gsv_space=$(dirname "$gsv_root"); fi
  gsv_tools=$gsv_space/lib/ground_scale_vo
}
# Prints the sourced devel space of the catkin workspace that contains this source tree, if any. Not
# one in the source tree: such a build may be out of date.
gsv_workspace() {
  local prefix prefixes source sources
  IFS=: read -r -a prefixes <<<"${CMAKE_PREFIX_PATH:-}"
  for prefix in "${prefixes[@]}"; do
    [[ -f $prefix/.catkin && -x $prefix/lib/ground_scale_vo/evaluate_bag ]] || continue
    [[ $prefix != "$gsv_root"/* ]] || continue
    IFS=';' read -r -a sources <"$prefix/.catkin" || true # catkin writes no newline
    for source in "${sources[@]}"; do
      [[ $gsv_root/ != "$source"/* ]] || { echo "$prefix" && return; }
    done
  done
}
# scripts/test sets GROUND_SCALE_VO_BUILD for the commands under test: they use its build as it is.
if [[ ${GROUND_SCALE_VO_BUILD:-} ]]; then
  gsv_use_build "$GROUND_SCALE_VO_BUILD"
else
  gsv_use_build "$gsv_root/build" "$(gsv_workspace)"
fi
gsv_builds_here() { [[ $gsv_space == "$gsv_build_folder/devel" ]]; }

# catkin needs the system's Python, not one of pyenv or conda.
PATH=/usr/bin:/bin:$PATH

# Prints the folder of ROS 1 outside of Debian's packages, such as Noetic or ROS One; ROS 2 has no catkin:
# the sourced one, else noetic, else any other in /opt/ros.
gsv_distribution() {
  local folder
  for folder in "${gsv_opt_ros:-/opt/ros}"/{"${ROS_DISTRO:-noetic}",noetic,*}; do
    [[ ! -f $folder/setup.bash || ! -d $folder/share/catkin ]] || { echo "$folder" && return; }
  done
}
gsv_source_distribution() {
  local distribution
  distribution=$(gsv_distribution)
  [[ -z ${ROS_ROOT:-} && $distribution ]] || return 0
  gsv_source "$distribution/setup.bash"
}
# gsv_source FILE: a setup script of ROS, which would fail under `set -u` and `set -e`.
gsv_source() {
  local options=$-
  set +eu
  source "$1"
  [[ $options != *e* ]] || set -e
  [[ $options != *u* ]] || set -u
}

# Prints the packages in these sections of packages.txt; [SECTION-RELEASE] belongs to [SECTION].
gsv_packages() {
  awk -v wanted=" $* " -v release="-$(. /etc/os-release && echo "${VERSION_CODENAME:-}")" '
    /^\[/ { section = substr($0, 2, length($0) - 2); sub(release "$", "", section); next }
    /^[a-z0-9]/ && index(wanted, " " section " ") { print $1 }
  ' "$gsv_lib/packages.txt"
}

gsv_setup() {
  if [[ $(gsv_distribution) ]]; then # never together with Debian's packages of ROS
    gsv_source_distribution
    return 0 # the user installs the dependencies: rosdep install --from-paths . --ignore-src
  fi
  local sections=(run "$@") packages=() missing=() package
  gsv_installed || sections+=(build)
  mapfile -t packages < <(gsv_packages "${sections[@]}")
  # One call for all packages; a package unknown to dpkg counts as missing.
  local installed
  installed=" $(dpkg-query -W -f '${db:Status-Status}=${Package} ' "${packages[@]}" 2>/dev/null || true) "
  for package in "${packages[@]}"; do
    [[ $installed == *" installed=$package "* ]] || missing+=("$package")
  done
  ((${#missing[@]})) || return 0
  if [[ ${GROUND_SCALE_VO_NO_INSTALL:-} ]]; then
    echo "set-up: ${#missing[@]} packages are missing: ${missing[*]}" >&2
    return 1
  fi

  local as_root=()
  if ((EUID != 0)); then
    if ! command -v sudo >/dev/null; then
      echo "set-up: ${#missing[@]} packages are missing, and installing them needs root or sudo: ${missing[*]}" >&2
      return 1
    fi
    as_root=(sudo)
  fi
  local log
  log=$(mktemp "${TMPDIR:-/tmp}/ground_scale_vo_setup.XXXXXX.log")
  local apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive LC_ALL=C apt-get -o DPkg::Lock::Timeout=600)
  local install=("${apt[@]}" install --no-install-recommends "${missing[@]}")
  # The package lists are refreshed only when they are missing or out of date.
  "${install[@]}" --dry-run >/dev/null 2>&1 || "${apt[@]}" update >"$log" 2>&1 || true
  local sizes # "Need to get ...", "After this operation, ..."
  sizes=$("${install[@]}" --assume-no 2>/dev/null | grep -E '^(Need|After)' | paste -sd ' ') || true
  echo "set-up: installing ${#missing[@]} packages with apt (log: $log). $sizes" >&2
  if [[ -t 0 && -t 2 && ! ${GROUND_SCALE_VO_YES:-} ]]; then
    local answer
    read -r -p 'set-up: continue? [Y/n] ' answer
    [[ ! $answer =~ ^[nN] ]] || return 1
  fi
  if ! "${install[@]}" -y >>"$log" 2>&1; then
    if ! { "${apt[@]}" update && "${install[@]}" -y; } >>"$log" 2>&1; then
      echo "set-up: apt could not install ${missing[*]}; see $log:" >&2
      grep -E '^E: ' "$log" | tail -n 3 >&2
      return 1
    fi
  fi
}

gsv_build() {
  gsv_builds_here || return 0
  [[ ${GROUND_SCALE_VO_BUILD:-} != "$gsv_build_folder" ]] || return 0
  gsv_source_distribution
  local build=$gsv_build_folder log=$gsv_build_folder/build.log jobs
  jobs=$(nproc)
  # At configuration, catkin puts into the tests' environment only folders that exist; the Python
  # modules of the messages are generated later.
  mkdir -p "$build/devel/lib/python3/dist-packages"
  if ! cmake -S "$gsv_root" -B "$build" \
    -DPYTHON_EXECUTABLE=/usr/bin/python3 -DPython3_EXECUTABLE=/usr/bin/python3 \
    "${gsv_cmake_arguments[@]}" >"$log" 2>&1; then
    grep -A 8 -m 1 'CMake Error' "$log" >&2 || tail -n 10 "$log" >&2
    echo "build: cmake failed, see $log" >&2
    return 1
  fi
  local targets=()
  (($# == 0)) || targets=(--target "$@")
  # The compiler's output goes to the log, the progress to the terminal.
  if ! (
    set -o pipefail
    cmake --build "$build" --parallel "$jobs" "${targets[@]}" 2>&1 | tee -a "$log" |
      gsv_show_progress
  ); then
    grep -E -A 4 -m 3 '(error:|Error [0-9]|undefined reference)' "$log" >&2 || tail -n 10 "$log" >&2
    echo "build: failed, see $log" >&2
    return 1
  fi
}
gsv_cmake_arguments=()

# Prints the progress: on a terminal one line that is overwritten, elsewhere a line every 30 s.
gsv_show_progress() {
  local line percent next_progress=$((SECONDS + 10))
  while IFS= read -r line; do
    [[ $line =~ ^\[\ *([0-9]+)%\]\ (Building|Linking|Built) ]] || continue
    percent=$((BASH_REMATCH[1] < 100 ? BASH_REMATCH[1] : 100)) # make counts files shared by two targets twice
    if [[ -t 2 ]]; then
      printf '\rbuild: %s%% ' "$percent" >&2
    elif [[ ${BASH_REMATCH[2]} == Building ]] && ((SECONDS >= next_progress)); then
      printf 'build: %s%%\n' "$percent" >&2
      next_progress=$((SECONDS + 30))
    fi
  done
  [[ ! -t 2 ]] || printf '\r\033[K' >&2
}

gsv_env() {
  gsv_source_distribution
  local setup=$gsv_space/setup.bash
  if [[ $gsv_space == /usr ]]; then
    return 0 # installed by the Debian package, beside Debian's ROS, which needs no environment
  fi
  if [[ ! -f $setup ]]; then
    echo "environment: there is no $setup; build first" >&2
    return 1
  fi
  gsv_source "$setup"
  gsv_builds_here || return 0
  export ROS_HOME=$gsv_build_folder/ros ROS_LOG_DIR=$gsv_build_folder/ros/log
  mkdir -p "$ROS_LOG_DIR"
}

gsv_command() {
  [[ -x /usr/bin/python3 ]] || gsv_setup # on a bare system before the arguments are read
  exec /usr/bin/python3 -B "$gsv_lib/$1.py" "${@:2}"
}

gsv_python() {
  gsv_setup python
  gsv_cmake_arguments=(-DGROUND_SCALE_VO_PYTHON=ON)
  gsv_build ground_scale_vo_python
  compgen -G "$gsv_tools/python/ground_scale_vo/_core*" >/dev/null || {
    echo "${0##*/}: $gsv_tools/python has no Python module: build with -DGROUND_SCALE_VO_PYTHON=ON" >&2
    return 1
  }
  # rosbag, for a bag, is in the environment of the distribution.
  gsv_source_distribution
  PYTHONPATH=$gsv_tools/python${PYTHONPATH:+:$PYTHONPATH} exec /usr/bin/python3 -m ground_scale_vo "$@"
}
