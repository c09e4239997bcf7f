"""Imports that the documentation named before modules moved keep working for one release."""

import importlib
import sys

import pytest

MOVED = {
    "pioneer_gazebo.adapters.learned_driver": "pioneer_gazebo.learning.training",
    "pioneer_gazebo.adapters.learning": "pioneer_gazebo.learning.environment",
    "pioneer_gazebo.core.pose": "pioneer_gazebo.world.pose",
    "pioneer_gazebo.core.robot": "pioneer_gazebo.world.robot",
}


@pytest.mark.parametrize("former", MOVED)
def test_a_former_name_gives_the_same_objects_and_warns(former: str) -> None:
    sys.modules.pop(former, None)
    with pytest.warns(DeprecationWarning, match=MOVED[former]):
        old = importlib.import_module(former)
    new = importlib.import_module(MOVED[former])
    public = [name for name in vars(new) if not name.startswith("_")]
    assert public
    for name in public:
        assert getattr(old, name) is getattr(new, name)
