# Set-up of the checkout, sourced by ./pioneer: Debian packages, Python environment, workspace.
# Every step checks whether it is already done, so that a finished set-up costs well under a second and an
# interrupted one resumes where it stopped.

setup_dir=$root/.setup
venv=$setup_dir/venv
workspace=$root/catkin_ws
minimum_free_mib=3072

# Exits with a one-line error: what is wrong and what to do.
die() {
  printf 'pioneer: %s\n' "$*" >&2
  exit 1
}

# as_root COMMAND...: runs the command as root, through sudo if necessary.
as_root() {
  if [[ $EUID -eq 0 ]]; then "$@"; else sudo "$@"; fi
}

# step LABEL LOG COMMAND...: runs a long command with its output in LOG; shows label, seconds and the log's last line.
step() {
  local label=$1 log=$2 started=$SECONDS next=15 pid elapsed
  shift 2
  mkdir -p "${log%/*}"
  # Job control gives the command its own process group, so that Ctrl-C here can end all of it.
  set -m
  "$@" >"$log" 2>&1 </dev/null &
  pid=$!
  set +m
  trap 'kill -TERM -- -'"$pid"' 2>/dev/null; wait; printf "\n"; die "interrupted; run the command again, it continues from here"' INT TERM HUP QUIT
  while ! timeout 1 tail --pid="$pid" -f /dev/null; do
    elapsed=$((SECONDS - started))
    if [[ -t 1 ]]; then
      printf '\r\033[K%s … %d s  %.60s' "$label" "$elapsed" "$(tail -n 1 "$log" | tr -cd '[:print:]')"
    elif ((elapsed >= next)); then
      printf '%s … %d s\n' "$label" "$elapsed"
      next=$((next + 15))
    fi
  done
  trap - INT TERM HUP QUIT
  if ! wait "$pid"; then
    [[ -t 1 ]] && printf '\n'
    explain_failure "$label" "$log"
  fi
  [[ -t 1 ]] && printf '\r\033[K'
  printf '%s: done in %d s\n' "$label" "$((SECONDS - started))"
}

# explain_failure LABEL LOG: reports a known cause in one line, else shows the end of the log.
explain_failure() {
  local label=$1 log=$2
  if grep -qiE 'no space left on device|not enough free space' "$log"; then
    die "$label failed: the disk is full. Free some space and run the command again (log: $log)"
  elif grep -qiE 'temporary failure resolving|could not resolve|failed to fetch|network is unreachable|connection (refused|timed out)|newconnectionerror|unable to fetch' "$log"; then
    die "$label failed: no network, or no way to Debian's mirror or PyPI. Check the connection and any proxy, then run the command again (log: $log)"
  fi
  tail -n 15 "$log" >&2
  die "$label failed; the lines above are the end of $log"
}

check_system() {
  local ID='' VERSION_ID='' os_release=${1:-/etc/os-release}
  [[ -r $os_release ]] && . "$os_release"
  [[ $ID == debian && $VERSION_ID =~ ^1[23]$ ]] ||
    die "unsupported system '${ID:-unknown} ${VERSION_ID:-}': Debian 12 or 13 is required, which ship ROS 1. Use the container image (docker/) or a Debian machine."
  [[ -w $root ]] || die "cannot write to $root; run as its owner, or through sudo"
}

# check_path: rejects folders in which CMake, make and catkin cannot build.
check_path() {
  local LC_ALL=C
  # Non-ASCII letters match because they are neither between space and ~ nor control characters.
  [[ $root =~ ^([A-Za-z0-9_./+,=@-]|[^ -~[:cntrl:]])+$ ]] ||
    die "this checkout is in '$root', where CMake and catkin cannot build; move it to a path of letters, digits and . _ - + , = @ /"
}

check_disk() {
  local free
  free=$(df --output=avail -m "$root" | tail -n 1)
  ((free >= minimum_free_mib)) ||
    die "only $free MiB free under $root and set-up needs $minimum_free_mib; free some space and run the command again"
}

# missing_packages PACKAGE...: prints those that are not installed.
missing_packages() {
  comm -23 <(printf '%s\n' "$@" | sort) \
    <(dpkg-query -W -f '${Package} ${db:Status-Status}\n' "$@" 2>/dev/null | awk '$2 == "installed" {print $1}' | sort)
}

apt_install() {
  export DEBIAN_FRONTEND=noninteractive
  # An interrupted dpkg refuses everything until it has finished what it began.
  as_root env DEBIAN_FRONTEND=noninteractive dpkg --configure -a
  as_root apt-get update -q
  # redis-server and rviz must not start services or ask questions here; recommendations would double the size.
  as_root env DEBIAN_FRONTEND=noninteractive RUNLEVEL=1 apt-get install -yq --no-install-recommends "$@"
}

# packages_of SECTION...: prints the packages in these sections of apt-packages.txt.
packages_of() {
  awk -v "names= $* " '/^## /{on = index(names, " "$2" ")} on && /^[a-z]/' "$root/apt-packages.txt"
}

# install_packages PACKAGE...: installs those that are missing.
install_packages() {
  local missing
  mapfile -t missing < <(missing_packages "$@")
  ((${#missing[@]})) || return 0
  check_disk
  [[ $EUID -eq 0 ]] || command -v sudo >/dev/null ||
    die "Debian packages are missing (${missing[*]:0:3} …); run this once as root, or install sudo"
  # Ask for the password here, where a person can answer; the step below has no terminal.
  [[ $EUID -eq 0 ]] || sudo -v || die "Debian packages are missing (${missing[*]:0:3} …) and sudo refused"
  step "Installing ${#missing[@]} Debian packages" "$setup_dir/log/apt.log" apt_install "${missing[@]}"
}

make_venv() {
  rm -rf "$venv"
  # The python3 on the PATH may be one that cannot import rospy (anaconda, pyenv); Debian's can.
  /usr/bin/python3 -m venv --system-site-packages "$venv"
  # --no-deps: the requirements list is complete, and Debian's numpy must not be shadowed.
  # PyPI has no wheel of pybullet for Debian 13's Python 3.13: pip compiles it, and GCC 14 rejects its C otherwise.
  CFLAGS="${CFLAGS:-} -Wno-incompatible-pointer-types" \
    "$venv/bin/pip" install --disable-pip-version-check --no-deps -r "$root/requirements.txt"
}

prepare_venv() {
  local stamp
  stamp=$(sha256sum "$root/requirements.txt")$(/usr/bin/python3 -V)$root
  [[ -f $venv/stamp && $(<"$venv/stamp") == "$stamp" ]] && return 0
  check_disk
  local label='Installing Python packages'
  /usr/bin/python3 -c 'import sys; sys.exit(sys.version_info >= (3, 12))' || label+=' (compiles pybullet, some 10 min)'
  step "$label" "$setup_dir/log/pip.log" make_venv
  printf '%s' "$stamp" >"$venv/stamp"
}

# workspace_read TEST...: lists the files whose content the build reads; TESTs are find expressions, such as -printf.
workspace_read() {
  find "$workspace/src" -type d -name __pycache__ -prune -o \( -name CMakeLists.txt -o -name package.xml -o -name setup.py \
    -o -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -name '*.cfg' -o -name '*.cmake*' -o -path '*/kernels/*.py' \
    -o -path '*/pioneer_kernels/*.py' \) -type f "$@"
}

# workspace_listed TEST...: lists the files of which only the existence matters to the build.
workspace_listed() {
  find "$workspace/src" \( -path '*/scripts/*' -o -path '*/src/*' -name __init__.py \) -type f "$@"
}

# workspace_state: prints a checksum that changes if the workspace must be built again.
workspace_state() {
  {
    workspace_read -printf '%p %T@\n'
    workspace_listed -printf '%p\n'
    printf '%s\n' "$root"
  } | sort | sha256sum
}

# make_workspace DEFINITION...: builds the workspace, with additional CMake definitions.
make_workspace() {
  # Build with the venv's interpreter, which catkin writes into every script: Debian 12's catkin reads the first name,
  # Debian 13's the second.
  (cd "$workspace" && catkin_make -j"$(nproc)" -D{PYTHON,Python}_EXECUTABLE="$venv/bin/python3" -DCATKIN_ENABLE_TESTING=OFF "$@")
}

# make_and_compile: the same, and compiles Python's bytecode: if the environment forbids Python to write it, every start
# of a node would compile all its imports.
make_and_compile() {
  make_workspace
  "$venv/bin/python3" -m compileall -q -j0 "$workspace/src" "$workspace/devel/lib/python3/dist-packages"
}

build_workspace() {
  local state
  state=$(workspace_state)
  [[ -f $setup_dir/workspace.stamp && -f $workspace/devel/setup.bash && $(<"$setup_dir/workspace.stamp") == "$state" ]] && return 0
  check_disk
  rm -f "$setup_dir/workspace.stamp"
  step "Building the workspace" "$setup_dir/log/build.log" make_and_compile
  printf '%s' "$state" >"$setup_dir/workspace.stamp"
}

# Under sudo, gives what was built to the user who called sudo, so that the next run works without it.
give_back() {
  [[ -n ${SUDO_UID:-} && $EUID -eq 0 ]] || return 0
  # -h: src/CMakeLists.txt is a symbolic link to a system file.
  find "$workspace/src" -name __pycache__ -print0 |
    xargs -0 chown -hR "$SUDO_UID:${SUDO_GID:-$SUDO_UID}" "$setup_dir" "$workspace/build" "$workspace/devel" "$workspace/src/CMakeLists.txt"
}

# setup [SECTION...]: the whole set-up, including these sections of the on-demand packages.
setup() {
  check_system
  mkdir -p "$setup_dir"
  exec {lock}>"$setup_dir/lock"
  flock -n "$lock" || { printf 'Waiting for another set-up of this checkout …\n'; flock "$lock"; }
  local before=$SECONDS
  install_packages $(sed '/^# On demand/Q' "$root/apt-packages.txt" | grep -vE '^\s*(#|$)')
  ((!$#)) || install_packages $(packages_of "$@")
  prepare_venv
  build_workspace
  ((SECONDS - before > 1)) && give_back
  exec {lock}>&-
}

# build_docs: builds HTML pages from the documents and from the API's docstrings.
build_docs() {
  install_packages python3-sphinx python3-myst-parser python3-sphinx-autoapi
  step "Building the documentation" "$setup_dir/log/docs.log" \
    /usr/bin/python3 -m sphinx -q -b html -d "$setup_dir/doctrees" "$root/docs" "$setup_dir/docs"
  printf 'Open %s\n' "$setup_dir/docs/index.html"
}

# enter_workspace: sets up the environment that nodes run in.
enter_workspace() {
  set +u
  . "$workspace/devel/setup.bash"
  set -u
  # The workspace's own commands come first: its xacro supports ROS 1's $(find), the venv's does not.
  export PATH=$workspace/devel/bin:$venv/bin:$PATH
  # Optional packages under the originals' names that forward to ours.
  [[ -z ${PIONEER_OVERLAY:-} ]] || export ROS_PACKAGE_PATH=$workspace/overlay:$ROS_PACKAGE_PATH
  # Packages in ~/.local, installed for another interpreter or version, could break this one.
  export PYTHONNOUSERSITE=1
  # Output into a pipe or log must be readable while the command runs.
  export PYTHONUNBUFFERED=1
}
