# On a bare machine with the package installed, in a copy of the sources: the packages' tests, against what is installed.
# Only the tests are of the sources. Those of a checkout (tools/test) are skipped.
root=$PWD
. tools/setup.bash
apt-get install -yq --no-install-recommends git $(packages_of plot network checks study browser)
printf '%s\n' /checks >"$(python3 -c 'import site; print(site.getsitepackages()[0])')/checks.pth"
# rostest and roslaunch look for a package's test files in its installed folder.
for package in $(find catkin_ws/src -name package.xml -printf '%h\n'); do
  [[ ! -d $package/test ]] || cp -r "$package/test" "/usr/share/${package##*/}/"
done
ln -sf /usr/bin/pioneer pioneer
# Unbuffered, so that the end of a failed check's log follows its line.
PYTHONUNBUFFERED=1 python3 tools/test.py unit rostest e2e
