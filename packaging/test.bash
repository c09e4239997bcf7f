# On a bare machine with the package installed, in a copy of the sources: the packages' tests, against what is installed.
# Nothing of the sources but the tests is used. Tests of the checkout itself (marker `checkout`, tools/test) are skipped.
section() { awk -v names=" $* " '/^## /{on = index(names, " " $2 " ")} on && /^[A-Za-z]/'; }
apt-get install -yq --no-install-recommends git python3-pip $(section checks study browser <apt-packages.txt)
section checks <requirements.txt >/tmp/requirements
python3 -m pip install --quiet --break-system-packages --no-deps -r /tmp/requirements
# rostest and roslaunch look for a package's test files in its installed folder.
for package in $(find catkin_ws/src -name package.xml -printf '%h\n'); do
  [[ ! -d $package/test ]] || cp -r "$package/test" "/usr/share/${package##*/}/"
done
ln -sf /usr/bin/pioneer pioneer
python3 tools/test.py unit rostest e2e
