# Completion of ./pioneer for Bash: source tools/completion.bash
# Takes commands and options from the commands' own help.
_pioneer() {
  local word=${COMP_WORDS[COMP_CWORD]} pioneer=${COMP_WORDS[0]} command=${COMP_WORDS[1]:-} words folder
  folder=$(dirname "$(readlink -f "$pioneer")") || return
  if ((COMP_CWORD == 1)); then
    words="$("$pioneer" --help | sed -nE 's/^  ([a-z-]+)  +.*/\1/p') --help --version"
  elif [[ ${COMP_WORDS[COMP_CWORD - 1]} == --world ]]; then
    words=$(cd "$folder/catkin_ws/src/pioneer_gazebo_ros/pioneer_gazebo/worlds" && printf '%s\n' *.world | sed 's/\.world$//')
  elif [[ $word != -* && $command == test ]]; then
    words="changed lint types unit launch rostest e2e containers"
  elif [[ $word != -* && $command == bench ]]; then
    words=$("$pioneer" bench --help | sed -nE 's/^    ([a-z0-9]+)\b.*/\1/p')
  elif [[ $word != -* && $command == teleop ]]; then
    words=$("$pioneer" status --json 2>/dev/null | grep -oE '"robot": "[^"]+"' | cut -d'"' -f4)
  elif [[ $word != */* && $word != -* && $command == run-scenario ]]; then
    words=$(cd "$folder/catkin_ws/src/pioneer_demo/scenarios" && printf '%s\n' *.yaml | sed 's/\.yaml$//')
  elif [[ $word == -* ]]; then
    words=$("$pioneer" "$command" --help 2>/dev/null | grep -oE -- '--[a-z][a-z0-9-]*' | sort -u)
  else
    COMPREPLY=($(compgen -f -- "$word"))
    return
  fi
  COMPREPLY=($(compgen -W "$words" -- "$word"))
}
complete -o default -F _pioneer pioneer ./pioneer
