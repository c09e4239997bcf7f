# The shell of ./pioneer shell: the user's own settings first, then the workspace, so that a python3 that the former
# put on the PATH does not mask the one with rospy.
[[ -f ~/.bashrc ]] && . ~/.bashrc
root=$PIONEER_ROOT
. "$root/tools/setup.bash"
enter_workspace
. "$root/tools/completion.bash"
set +u
PS1="(pioneer) $PS1"
