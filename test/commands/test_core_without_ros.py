"""The library without ROS: used by examples/ as by another project. By default they link the library of the
build under test, which is the same code; the build and the installation without ROS are long tests."""

import math
import os
import pathlib
import re
import subprocess

import numpy as np
import pytest
from conftest import BUILD, CAMERA_HEIGHT, FRAMES, ROOT, assert_refused, pip_install, poses_of, run

LIBRARY = BUILD / "devel/lib/libground_scale_vo_core.so"
MODULES = ("common", "input", "vo", "scale", "lens")
# Says where an installation without ROS would be.
CONFIG = f"""
find_package(Eigen3 REQUIRED)
find_package(OpenCV 4 REQUIRED COMPONENTS core)
add_library(ground_scale_vo::core SHARED IMPORTED)
set_target_properties(ground_scale_vo::core PROPERTIES
  IMPORTED_LOCATION {LIBRARY}
  INTERFACE_INCLUDE_DIRECTORIES {ROOT}/include INTERFACE_COMPILE_FEATURES cxx_std_17
  INTERFACE_LINK_LIBRARIES "Eigen3::Eigen;opencv_core")
"""


@pytest.fixture(scope="module")
def build():
    """A build without ROS, with tools and the Python module, kept between runs."""
    folder = BUILD / "core_without_ros"
    run("cmake", "-S", ROOT, "-B", folder, "-DGROUND_SCALE_VO_ROS=OFF", "-DGROUND_SCALE_VO_PYTHON=ON",
        "-DCMAKE_DISABLE_FIND_PACKAGE_catkin=ON",
        "-DPYTHON_EXECUTABLE=/usr/bin/python3", "-DPython3_EXECUTABLE=/usr/bin/python3")
    run("cmake", "--build", folder, "--parallel", os.cpu_count(), timeout=None)
    return folder


def build_examples(folder, prefix):
    run("cmake", "-S", ROOT / "examples", "-B", folder, f"-DCMAKE_PREFIX_PATH={prefix}")
    run("cmake", "--build", folder, "--parallel", 2)


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    folder = tmp_path_factory.mktemp("examples")
    (folder / "ground_scale_vo-config.cmake").write_text(CONFIG)
    build_examples(folder, folder)
    return folder


def assert_without_ros(objects):
    files = [*objects.rglob("*.d"), *objects.rglob("depend.make")]  # the latter before CMake 3.20
    dependencies = "".join(file.read_text() for file in files)
    assert "Eigen" in dependencies and "/ros/" not in dependencies


def test_library_needs_only_eigen_and_opencv():
    """Neither its headers nor the library include or link ROS."""
    assert_without_ros(BUILD / "CMakeFiles/ground_scale_vo_core.dir")
    include = ROOT / "include/ground_scale_vo"
    headers = [include / "metric_odometry.hpp",
               *(header for module in MODULES for header in (include / module).rglob("*.hpp"))]
    included = {name for header in headers for name in re.findall(r"#include <(\S+/\S+)>", header.read_text())}
    assert {name for name in included if not name.startswith("Eigen/")} == {"opencv2/core.hpp"}
    libraries = [line.split()[0].lower() for line in run("ldd", LIBRARY).stdout.splitlines()]
    assert not any("ros" in pathlib.Path(name).name for name in libraries), libraries


@pytest.mark.long
def test_build_without_ros(build, short, tmp_path):
    assert_without_ros(build)
    commands = (build / "compile_commands.json").read_text()
    for folder in ("/opt/ros", "/usr/include/ros", "catkin"):
        assert folder not in commands
    installed = tmp_path / "installed"
    run("cmake", "--install", build, "--prefix", installed)
    modules = {entry.name for entry in (installed / "include/ground_scale_vo").iterdir()}
    assert modules == {*MODULES, "metric_odometry.hpp", "self_calibrating_odometry.hpp"}
    build_examples(tmp_path / "examples", installed)
    (tool,) = installed.rglob("run_sequence")
    run(tool, short, "--camera-height", CAMERA_HEIGHT, "--out", tmp_path)
    assert len(poses_of(tmp_path / "short/poses.txt")) == FRAMES


def test_examples_give_metric_poses(examples, venv, short):
    """The programs in C++ and Python print the same."""
    output = run(examples / "metric_poses", short, CAMERA_HEIGHT).stdout
    estimate = [[float(word) for word in line.split()] for line in output.splitlines()]
    assert len(estimate) > FRAMES / 2
    stamps = [float(line) for line in (short / "times.txt").read_text().split()]
    position = {round(stamp, 3): pose[:, 3] for stamp, pose in zip(stamps, poses_of(short / "poses.txt"))}
    first, last = estimate[0], estimate[-1]
    true_distance = math.dist(position[round(first[0], 3)], position[round(last[0], 3)])
    assert true_distance > 10  # [m]
    assert math.dist(first[1:], last[1:]) == pytest.approx(true_distance, rel=0.03)
    python = (venv / "bin/python", ROOT / "examples/metric_poses.py")
    assert run(*python, short, CAMERA_HEIGHT).stdout.split() == output.split()
    for example in ([examples / "metric_poses"], python):
        assert_refused(1, "no such f", *example, "none", 1.65)


@pytest.mark.long
def test_pip_installs_a_build_without_ros(build, evaluated, short, tmp_path):
    pip_install(tmp_path / "venv", build)
    run(tmp_path / "venv/bin/ground_scale_vo", "run", short, "--camera-height", CAMERA_HEIGHT, "--out", tmp_path)
    assert (tmp_path / "short/poses.txt").read_text() == (evaluated / "poses.txt").read_text()


def test_scale_of_another_odometry(examples, gsv, short):
    """That odometry is this one with another unit of length, 4 m."""
    sequence = gsv.open_drive(short)
    odometry = gsv.MetricOdometry(sequence.camera, CAMERA_HEIGHT)
    words, final = list(sequence.camera[:6]), None
    for image, stamp in sequence:
        result = odometry.process(image, stamp)
        if result.pose is None:
            continue
        pose, points = result.pose[:3].copy(), result.points / 4
        pose[:, 3] /= 4
        usable = [i for i, point in enumerate(points) if np.isfinite(point).all()]
        words += [stamp, len(usable), *pose.ravel()]
        for i in usable:
            words += [result.track_ids[i], *result.tracks[i], *points[i], 0.005 * points[i][2]]
        final = result.pose[:3, 3]
    done = subprocess.run([examples / "scale_of_another_vo", str(CAMERA_HEIGHT)], stdout=subprocess.PIPE,
                          input=" ".join(map(str, words)), text=True, check=True)
    stamp, scale, sigma, *position = map(float, done.stdout.splitlines()[-1].split())
    assert stamp == 3.9 and scale == pytest.approx(4, rel=0.05) and 0 < sigma < 0.4
    assert np.linalg.norm(position) == pytest.approx(np.linalg.norm(final), rel=0.08)
