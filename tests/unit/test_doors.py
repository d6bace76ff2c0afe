"""Packages load what is behind their doors when it is asked for."""

import pkgutil
from importlib import import_module

import pytest

import calib
import posedesign

FOUND = [
    found.name
    for root in (calib, posedesign)
    for found in pkgutil.walk_packages(root.__path__, f"{root.__name__}.")
    if found.ispkg
]
PACKAGES = [
    name
    for name in ("calib", "posedesign", *FOUND)
    if hasattr(import_module(name), "load_when_asked")
]


def test_there_are_doors():
    assert {"calib", "posedesign", "calib.identification", "calib.robot_world"} <= set(PACKAGES)


@pytest.mark.parametrize("name", PACKAGES)
def test_all_names_of_a_door_are_there(name):
    package = import_module(name)
    assert all(hasattr(package, public) for public in package.__all__)
    with pytest.raises(AttributeError, match=f"'{name}' has no attribute 'nonsense'"):
        package.nonsense  # noqa: B018


@pytest.mark.parametrize("name", PACKAGES)
def test_no_name_of_a_door_is_that_of_a_module_behind_it(name):
    """A module takes the place of such a name as soon as it is loaded."""
    package = import_module(name)
    modules = {found.name for found in pkgutil.iter_modules(package.__path__)}
    for both in modules & set(package.__all__):
        assert getattr(package, both) is import_module(f"{name}.{both}")
