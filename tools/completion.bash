# Completion of ./pioneer for Bash: source tools/completion.bash
# Takes commands and options from the commands' own help.
_pioneer() {
  local word=${COMP_WORDS[COMP_CWORD]} pioneer=${COMP_WORDS[0]} command=${COMP_WORDS[1]:-} words folder
  local before=${COMP_WORDS[COMP_CWORD - 1]} files=()
  folder=$(dirname "$(readlink -f "$pioneer")") || return
  if ((COMP_CWORD == 1)); then
    words="$("$pioneer" --help | sed -nE 's/^  ([a-z-]+)  +.*/\1/p') --help --version"
  elif [[ $before == --world ]]; then
    files=(world)
    words=$(cd "$folder/catkin_ws/src/pioneer_gazebo_ros/pioneer_gazebo/worlds" && printf '%s\n' *.world | sed 's/\.world$//')
  elif [[ $before == --fleet && $command =~ ^(status|rviz|teleop)$ ]]; then
    words=$("$pioneer" status --json 2>/dev/null | grep -oE '"pid": [0-9]+' | cut -d' ' -f2)
  elif [[ $before == --fleet ]]; then
    files=(yaml yml) words=
  elif [[ $before == --record || $before == --repair ]]; then
    files=(mcap bag) words=
  elif [[ $before == --report || $before == --log || $before == --output ]]; then
    COMPREPLY=($(compgen -d -- "$word"))
    return
  elif [[ $word != -* && $command == test ]]; then
    words="changed lint types unit launch rostest e2e containers"
  elif [[ $word != -* && $command == bench ]]; then
    words=$("$pioneer" bench --help | sed -nE 's/^    ([a-z0-9]+)\b.*/\1/p')
  elif [[ $word != -* && $command == teleop ]]; then
    words=$("$pioneer" status --json 2>/dev/null | grep -oE '"robot": "[^"]+"' | cut -d'"' -f4)
  elif [[ $word != -* && $command == replay ]]; then
    files=(mcap bag) words=
  elif [[ $word != -* && $command == experiment ]]; then
    files=(yaml yml) words=
  elif [[ $word != -* && $command == run-scenario ]]; then
    files=(yaml yml)
    words=$(cd "$folder/catkin_ws/src/pioneer_demo/scenarios" && printf '%s\n' *.yaml | sed 's/\.yaml$//')
  elif [[ $word == -* ]]; then
    words=$("$pioneer" "$command" --help 2>/dev/null | grep -oE -- '--[a-z][a-z0-9-]*' | sort -u)
  else
    COMPREPLY=($(compgen -f -- "$word"))
    return
  fi
  COMPREPLY=($(compgen -W "$words" -- "$word"))
  ((${#files[@]})) && _pioneer_files "$word" "${files[@]}"
}

# _pioneer_files WORD SUFFIX...: also offers files with these suffixes, and folders, in which there may be some.
_pioneer_files() {
  local word=$1 suffix path
  shift
  for suffix; do
    COMPREPLY+=($(compgen -f -X "!*.$suffix" -- "$word"))
  done
  while IFS= read -r path; do
    COMPREPLY+=("$path/")
  done < <(compgen -d -- "$word")
  [[ ${COMPREPLY[*]} != */ ]] || compopt -o nospace 2>/dev/null
}
complete -o default -F _pioneer pioneer ./pioneer
