"""The workspace's ``xacro`` supports Indigo's syntax and the features that newer robots use."""

import subprocess
from pathlib import Path

import pytest

NEW = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="robot" default="left"/>
  <xacro:property name="side" value="$(arg robot)" lazy_eval="false"/>
  <xacro:property name="data" value="${xacro.load_yaml('numbers.yaml')}"/>
  <xacro:property name="doubled" value="${[2 * one for one in data.radii]}"/>
  <xacro:macro name="inertial" params="mass:=${data.mass} *block"><weight value="${mass}"/></xacro:macro>
  <xacro:if value="${len(doubled) == 2 and side in ('left', 'right')}">
    <link name="${side}_wheel" file="$(find pioneer_description)/urdf" radius="${python.sum(doubled)}"/>
  </xacro:if>
  <inertial/>
  <xacro:inertial><b/></xacro:inertial>
</robot>"""
INDIGO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <include filename="part.xacro"/>
  <property name="radius" value="0.1"/>
  <macro name="wheel" params="side"><link name="${side}" radius="${radius * 2}"/><joint name="${side}_joint"/></macro>
  <wheel side="left"/><part/>
  <gazebo><plugin name="p" filename="q"><property>kept</property><include><uri>model://kept</uri></include></plugin></gazebo>
</robot>"""


def run(folder: Path, text: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    (folder / "robot.xacro").write_text(text)
    command = ["xacro", *arguments, "robot.xacro"]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, timeout=60
    )


def test_features_of_the_newest_xacro_work_on_ros_1(tmp_path: Path) -> None:
    (tmp_path / "numbers.yaml").write_text("radii: [1, 2]\nmass: 3.5\n")
    result = run(tmp_path, NEW, "--inorder")
    assert result.returncode == 0, result.stderr
    assert 'name="left_wheel"' in result.stdout
    assert 'radius="6"' in result.stdout
    assert "pioneer_description/urdf" in result.stdout
    assert "<inertial/>" in result.stdout, "a URDF element is no call of the macro of its name"
    assert '<weight value="3.5"/>' in result.stdout


def test_indigos_tags_without_prefix_work_with_one_warning_a_file(tmp_path: Path) -> None:
    part = '<robot><macro name="part" params=""><link name="part"/></macro></robot>'
    (tmp_path / "part.xacro").write_text(part)
    result = run(tmp_path, INDIGO, "--legacy")
    assert result.returncode == 0, result.stderr
    assert '<link name="left" radius="0.2"/>' in result.stdout
    assert '<link name="part"/>' in result.stdout
    assert "<property>kept</property>" in result.stdout
    assert "<uri>model://kept</uri>" in result.stdout
    warnings = [line for line in result.stderr.splitlines() if "has no 'xacro:' prefix" in line]
    assert len(warnings) == 2, result.stderr


@pytest.mark.parametrize("place", ["$(find no_such_package)", "${undefined_name}"])
def test_what_cannot_be_expanded_is_refused_with_its_name_and_file(
    tmp_path: Path, place: str
) -> None:
    result = run(tmp_path, f'<robot name="r"><link name="{place}"/></robot>')
    assert result.returncode == 2
    assert place.strip("${}() ").split()[-1] in result.stderr
    assert "robot.xacro" in result.stderr
