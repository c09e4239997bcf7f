# On a bare machine with the package installed: the commands work, and the demo reaches its waypoints.
pioneer --version
rosrun pioneer_gazebo snapshot --help
roslaunch --files pioneer_gazebo pioneer_world.launch
# Not by exec: the demo measures time from the start of its process.
pioneer demo --robots 2 --world small_world --record fleet.mcap --web
test -s demo-report/fleet.png
test -s fleet.mcap
