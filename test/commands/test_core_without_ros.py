"""The library without ROS: used by examples/ as by another project. By default they link the library of the
build under test, which is the same code; the build and the installation without ROS are long tests."""

import math
import os
import pathlib
import re
import subprocess

import numpy as np
import pytest
from conftest import BUILD, CAMERA_HEIGHT, ROOT, WITHOUT_MESSAGES, assert_refused, pip_install, run

FRAMES = 40
# Says where an installation without ROS would be.
CONFIG = f"""
find_package(Eigen3 REQUIRED)
find_package(OpenCV 4 REQUIRED COMPONENTS core)
add_library(ground_scale_vo::core SHARED IMPORTED)
set_target_properties(ground_scale_vo::core PROPERTIES
  IMPORTED_LOCATION {BUILD}/devel/lib/libground_scale_vo_core.so
  INTERFACE_INCLUDE_DIRECTORIES {ROOT}/include INTERFACE_COMPILE_FEATURES cxx_std_17
  INTERFACE_LINK_LIBRARIES "Eigen3::Eigen;opencv_core")
"""
BUILT_OR_INSTALLED = ["built", pytest.param("installed", marks=pytest.mark.long)]


@pytest.fixture(scope="module")
def build():
    """A build without ROS, with tools and the Python module, kept between runs."""
    folder = BUILD / "core_without_ros"
    run("cmake", "-S", ROOT, "-B", folder, "-DGROUND_SCALE_VO_ROS=OFF", "-DGROUND_SCALE_VO_PYTHON=ON",
        "-DCMAKE_DISABLE_FIND_PACKAGE_catkin=ON",
        "-DPYTHON_EXECUTABLE=/usr/bin/python3", "-DPython3_EXECUTABLE=/usr/bin/python3")
    run("cmake", "--build", folder, "--parallel", os.cpu_count(), timeout=None)
    return folder


@pytest.fixture(scope="module")
def installed(build, tmp_path_factory):
    prefix = tmp_path_factory.mktemp("prefix")
    run("cmake", "--install", build, "--prefix", prefix)
    return prefix


@pytest.fixture(scope="module")
def drive(short):
    return short


def assert_without_ros(objects):
    dependencies = "".join(file.read_text() for file in objects.rglob("*.d"))
    assert "Eigen" in dependencies and "/ros/" not in dependencies


def test_core_is_compiled_without_ros_headers():
    assert_without_ros(BUILD / "CMakeFiles/ground_scale_vo_core.dir")


@pytest.mark.long
def test_compiles_without_ros_headers(build):
    commands = (build / "compile_commands.json").read_text()
    for folder in ("/opt/ros", "/usr/include/ros", "catkin"):
        assert folder not in commands
    assert_without_ros(build)


@pytest.mark.long
def test_installs_only_the_headers_of_the_core(installed):
    modules = {entry.name for entry in (installed / "include/ground_scale_vo").iterdir()}
    assert modules == {"common", "vo", "scale", "metric_odometry.hpp"}


@pytest.mark.parametrize("source", BUILT_OR_INSTALLED)
def test_headers_include_only_eigen_and_the_core_of_opencv(request, source):
    include = (ROOT if source == "built" else request.getfixturevalue("installed")) / "include/ground_scale_vo"
    headers = [include / "metric_odometry.hpp",
               *(header for module in ("common", "vo", "scale") for header in (include / module).rglob("*.hpp"))]
    included = {name for header in headers for name in re.findall(r"#include <(\S+/\S+)>", header.read_text())}
    assert {name for name in included if not name.startswith("Eigen/")} == {"opencv2/core.hpp"}


@pytest.mark.parametrize("source", BUILT_OR_INSTALLED)
def test_library_links_no_tooling(request, source):
    folder = BUILD / "devel/lib" if source == "built" else request.getfixturevalue("installed")
    (library,) = folder.rglob("libground_scale_vo_core.so")
    symbols = run("nm", "--dynamic", "--demangle", "--defined-only", library).stdout
    assert "ground_scale_vo::MetricOdometry::process" in symbols
    for tooling in ("KittiSequence", "SyntheticDrive", "RunReport"):
        assert f"ground_scale_vo::{tooling}" not in symbols
    libraries = [line.split()[0].lower() for line in run("ldd", library).stdout.splitlines()]
    assert not any("ros" in pathlib.Path(name).name for name in libraries), libraries


@pytest.mark.long
def test_installed_tool_runs(installed, drive, tmp_path):
    (tool,) = installed.rglob("run_sequence")
    run(tool, drive, "--camera-height", CAMERA_HEIGHT, "--out", tmp_path)
    assert len((tmp_path / drive.name / "poses.txt").read_text().splitlines()) == FRAMES


@pytest.fixture(scope="module", params=BUILT_OR_INSTALLED)
def examples(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("example")
    if request.param == "built":
        (folder / "ground_scale_vo-config.cmake").write_text(CONFIG)
        prefix = folder
    else:
        prefix = request.getfixturevalue("installed")
    run("cmake", "-S", ROOT / "examples", "-B", folder, f"-DCMAKE_PREFIX_PATH={prefix}")
    run("cmake", "--build", folder)
    return folder


@pytest.mark.parametrize("folder, height, text", [
    ("DRIVE", "high", "HEIGHT is 'high', it must be a number [m]"),
    ("none", "1.65", "none/image_0: no such folder"),
    ("EMPTY", "1.65", "image_0: no images"),
    ("UNCALIBRATED", "1.65", "calib.txt: no projection matrix"),
])
def test_example_refuses(examples, drive, tmp_path, folder, height, text):
    for name in ("empty", "uncalibrated"):
        (tmp_path / name / "image_0").mkdir(parents=True)
    (tmp_path / "uncalibrated/image_0/000000.png").symlink_to(drive / "image_0/000000.png")
    folder = drive if folder == "DRIVE" else tmp_path / folder.lower()
    done = subprocess.run([examples / "metric_poses", folder, height], stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1 and text in done.stderr and done.stderr.count("\n") == 1, done.stderr


def test_example_gives_metric_poses(examples, drive):
    lines = run(examples / "metric_poses", drive, CAMERA_HEIGHT).stdout.splitlines()
    estimate = [[float(word) for word in line.split()] for line in lines]
    assert len(estimate) > FRAMES / 2

    stamps = [float(line) for line in (drive / "times.txt").read_text().split()]
    poses = [[float(word) for word in line.split()]
             for line in (drive / "poses.txt").read_text().splitlines()]
    position = {round(stamp, 3): pose[3::4] for stamp, pose in zip(stamps, poses)}
    first, last = estimate[0], estimate[-1]
    distance = math.dist(first[1:], last[1:])
    true_distance = math.dist(position[round(first[0], 3)], position[round(last[0], 3)])
    assert true_distance > 10  # [m]
    assert distance == pytest.approx(true_distance, rel=0.03)


def test_python_example_as_the_other(examples, venv, drive):
    done = run(venv / "bin/python", ROOT / "examples/metric_poses.py", drive, CAMERA_HEIGHT,
               env=WITHOUT_MESSAGES)
    assert done.stdout.split() == run(examples / "metric_poses", drive, CAMERA_HEIGHT).stdout.split()


@pytest.mark.long
def test_pip_installs_a_build_without_ros(build, examples, drive, tmp_path):
    pip_install(tmp_path / "venv", build)
    done = run(tmp_path / "venv/bin/python", ROOT / "examples/metric_poses.py", drive, CAMERA_HEIGHT,
               env=WITHOUT_MESSAGES)
    assert done.stdout.split() == run(examples / "metric_poses", drive, CAMERA_HEIGHT).stdout.split()


def test_python_example_refuses(venv):
    assert_refused(1, "/none: no such folder", venv / "bin/python",
                   ROOT / "examples/metric_poses.py", "none", 1.65, env=WITHOUT_MESSAGES)


def test_scale_of_another_odometry(examples, gsv, drive):
    """That odometry is this one with another unit of length, 4 m."""
    sequence = gsv.read_kitti(drive)
    odometry = gsv.MetricOdometry(sequence.camera, CAMERA_HEIGHT)
    words, final = list(sequence.camera), None
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
