# Set-up, build and environment for the commands in scripts/. Sourced, not run.
#
#   gsv_setup [section...]   installs what is missing of packages.txt: [run], [build], these sections
#   gsv_build [target...]    configures and builds to $gsv_build_folder; no target: everything
#   gsv_env                  makes ROS and this build usable in the calling shell
#   gsv_show_launch NAME PID filters what kitti.launch says: progress, warnings, errors. Ends roslaunch,
#                            whose process id stands in the file PID, when a node cannot be started
#   gsv_find_folders OUT SEQ...
#                            the folders of sequences whose results go to OUT/<name>, to gsv_folders
#   $gsv_tools               the folder of the package's programs
#   $gsv_build_folder        <root>/build unless gsv_use_build FOLDER chose another one
#
# Each returns non-zero after one sentence on stderr when it fails. In an install space, where the
# commands lie beside the programs, there is nothing to build.

gsv_lib=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
gsv_root=$(cd "$gsv_lib/../.." && pwd)
gsv_installed() { [[ ! -f $gsv_root/CMakeLists.txt ]]; }
gsv_use_build() {
  gsv_build_folder=$1
  gsv_space=$gsv_build_folder/devel
  if gsv_installed; then gsv_space=$(dirname "$gsv_root"); fi
  gsv_tools=$gsv_space/lib/ground_scale_vo
}
gsv_use_build "$gsv_root/build"

# A Python that stands before /usr/bin (pyenv, conda) breaks catkin, which needs the system's.
PATH=/usr/bin:/bin:$PATH

# On Noetic everything lies under /opt/ros; on Debian there is no such folder and nothing to source.
gsv_source_distribution() {
  local distribution=/opt/ros/${ROS_DISTRO:-noetic}
  [[ -z ${ROS_ROOT:-} && -f $distribution/setup.bash ]] || return 0
  # These scripts are not made for `set -u` and `set -e`.
  local options=$-
  set +eu
  source "$distribution/setup.bash"
  [[ $options != *e* ]] || set -e
  [[ $options != *u* ]] || set -u
}

# The packages of packages.txt in the sections named.
gsv_packages() {
  awk -v wanted=" $* " '
    /^\[/ { section = substr($0, 2, length($0) - 2); next }
    /^[a-z0-9]/ && index(wanted, " " section " ") { print $1 }
  ' "$gsv_lib/packages.txt"
}

gsv_setup() {
  if [[ -d /opt/ros/${ROS_DISTRO:-noetic} ]]; then
    gsv_source_distribution
    return 0 # there rosdep installs: rosdep install --from-paths . --ignore-src
  fi
  local sections=(run "$@") packages=() missing=() package
  gsv_installed || sections+=(build)
  mapfile -t packages < <(gsv_packages "${sections[@]}")
  # One call for all of them; a name that dpkg does not know is missing too.
  local installed
  installed=" $(dpkg-query -W -f '${db:Status-Status}=${Package} ' "${packages[@]}" 2>/dev/null || true) "
  for package in "${packages[@]}"; do
    [[ $installed == *" installed=$package "* ]] || missing+=("$package")
  done
  ((${#missing[@]})) || return 0

  local as_root=()
  if ((EUID != 0)); then
    if ! command -v sudo >/dev/null; then
      echo "set-up: ${#missing[@]} packages are missing and neither root nor sudo is there to install them: ${missing[*]}" >&2
      return 1
    fi
    as_root=(sudo)
  fi
  local log
  log=$(mktemp "${TMPDIR:-/tmp}/ground_scale_vo_setup.XXXXXX.log")
  echo "set-up: installing ${#missing[@]} packages with apt (log: $log)" >&2
  local apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=600)
  local install=("${apt[@]}" install -y --no-install-recommends "${missing[@]}")
  # The package lists are refreshed only when they are missing or out of date.
  if ! "${install[@]}" >"$log" 2>&1; then
    if ! { "${apt[@]}" update && "${install[@]}"; } >>"$log" 2>&1; then
      echo "set-up: apt could not install ${missing[*]}; the reason stands in $log:" >&2
      grep -E '^E: ' "$log" | tail -n 3 >&2
      return 1
    fi
  fi
}

gsv_build() {
  gsv_installed && return 0
  gsv_source_distribution
  local build=$gsv_build_folder log=$gsv_build_folder/build.log jobs
  jobs=${GSV_JOBS:-$(nproc)}
  # catkin notes the environment of the tests when it configures, and leaves out what is not there yet:
  # the folder of the messages' Python modules.
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
  # The compiler's lines go to the log; the terminal sees how far it is.
  if ! (
    set -o pipefail
    cmake --build "$build" --parallel "$jobs" "${targets[@]}" 2>&1 | tee -a "$log" |
      gsv_show_progress
  ); then
    grep -E -A 4 -m 3 '(error:|Error [0-9]|undefined reference)' "$log" >&2
    echo "build: failed, see $log" >&2
    return 1
  fi
}
gsv_cmake_arguments=()

# On a terminal in one line, in a log now and then, and only while something is made.
gsv_show_progress() {
  local line made at=$((SECONDS + 10))
  while IFS= read -r line; do
    [[ $line =~ ^\[\ *([0-9]+)%\]\ (Building|Linking|Built) ]] || continue
    made=$((BASH_REMATCH[1] < 100 ? BASH_REMATCH[1] : 100)) # make counts twice what two targets share
    if [[ -t 2 ]]; then
      printf '\rbuild: %s%% ' "$made" >&2
    elif [[ ${BASH_REMATCH[2]} == Building ]] && ((SECONDS >= at)); then
      printf 'build: %s%%\n' "$made" >&2
      at=$((SECONDS + 30))
    fi
  done
  [[ ! -t 2 ]] || printf '\r\033[K' >&2
}

gsv_env() {
  gsv_source_distribution
  local setup=$gsv_space/setup.bash options=$-
  if [[ $gsv_space == /usr ]]; then
    return 0 # of a Debian package: ROS lies there too, and needs no environment
  fi
  if [[ ! -f $setup ]]; then
    echo "environment: there is no $setup, nothing is built" >&2
    return 1
  fi
  set +eu
  source "$setup"
  [[ $options != *e* ]] || set -e
  [[ $options != *u* ]] || set -u
  gsv_installed && return 0
  export ROS_HOME=$gsv_build_folder/ros ROS_LOG_DIR=$gsv_build_folder/ros/log
  mkdir -p "$ROS_LOG_DIR"
}

gsv_find_folders() {
  local out=$1 sequence folder name
  local -A folder_of=()
  gsv_folders=()
  for sequence in "${@:2}"; do
    folder=$(cd -- "$sequence" 2>/dev/null && pwd) || {
      echo "${0##*/}: $sequence: no such folder" >&2
      return 1
    }
    name=$(basename "$folder")
    [[ -z ${folder_of[$name]:-} ]] || {
      echo "${0##*/}: ${folder_of[$name]} and $folder have the same name and would share $out/$name" >&2
      return 1
    }
    folder_of[$name]=$folder
    gsv_folders+=("$folder")
  done
}

# Of all that roslaunch says the terminal sees the progress, under this name, warnings and errors; a
# log sees the progress now and then.
gsv_show_launch() {
  local name=$1 pid_file=$2 line at=0 over=no
  shopt -s extglob
  while IFS= read -r line; do
    line=${line//$'\e'\[*([0-9;])m/}
    case $line in
      'progress: '*)
        if [[ -t 2 ]]; then
          printf '\r\e[K%s: %s' "$name" "${line#progress: }" >&2
        elif ((SECONDS >= at)); then
          printf '%s: %s\n' "$name" "${line#progress: }" >&2
          at=$((SECONDS + 10))
        fi
        ;;
      *'play_bag: '*) # roslaunch may have written before it on the same line
        [[ ! -t 2 ]] || printf '\r\e[K' >&2
        printf 'play_bag: %s\n' "${line##*play_bag: }" >&2
        over=yes # what the others say while they are ended is no news
        ;;
      *'cannot launch node of type'*) # roslaunch goes on without it, even when it is required
        [[ ! -t 2 ]] || printf '\r\e[K' >&2
        printf '%s: roslaunch cannot start %s\n' "$name" "${line#*cannot launch node of type }" >&2
        kill -TERM "$(<"$pid_file")" 2>/dev/null || true
        over=yes
        ;;
      *'REQUIRED process ['*'] has died!'*)
        # So ends play_bag when all is well; else it has said why.
        [[ $over == no && $line != *'[play_bag-'* ]] || continue
        [[ ! -t 2 ]] || printf '\r\e[K' >&2
        line=${line#*REQUIRED process [}
        printf '%s: the node %s has ended before the bag\n' "$name" "${line%%-+([0-9])]*}" >&2
        over=yes
        ;;
      '[rviz-'*'process has died'*)
        [[ ! -t 2 ]] || printf '\r\e[K' >&2
        printf '%s: rviz could not open its window on the display "%s", or broke down; the run goes on without it\n' \
          "$name" "${DISPLAY:-}" >&2
        ;;
      *'[ WARN]'* | *'[ERROR]'* | *'[FATAL]'*)
        [[ $over == no ]] || continue
        [[ ! -t 2 ]] || printf '\r\e[K' >&2
        printf '%s\n' "$line" >&2
        ;;
    esac
  done
  [[ ! -t 2 ]] || printf '\n' >&2
}
