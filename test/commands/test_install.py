"""The install space and the Debian package contain everything that a run needs."""

import os
import re
import shutil

import pytest
from conftest import BUILD, SCRIPTS, assert_plays, assert_refused, run

pytestmark = pytest.mark.serial

FILES = """
lib/ground_scale_vo/evaluate lib/ground_scale_vo/kitti_to_bag lib/ground_scale_vo/playback_monitor
lib/ground_scale_vo/view_frame lib/ground_scale_vo/bag_recorder
lib/ground_scale_vo/benchmark_sequence lib/ground_scale_vo/evaluate_bag
lib/ground_scale_vo/evaluate_faults lib/ground_scale_vo/evaluate_scenarios
lib/ground_scale_vo/graph_observer lib/ground_scale_vo/ground_truth_relay
lib/ground_scale_vo/height_from_drive lib/ground_scale_vo/render_drive
lib/ground_scale_vo/run_sequence
lib/ground_scale_vo/screenshot lib/ground_scale_vo/lib/pause_at_frame.py
include/ground_scale_vo/VoFrame.h include/ground_scale_vo/scale/scale_recovery.hpp
share/ground_scale_vo/package.xml share/ground_scale_vo/nodelet_plugins.xml
share/ground_scale_vo/launch/kitti.launch share/ground_scale_vo/config/mono_vo.yaml
share/ground_scale_vo/rviz/ground_scale_vo.rviz
""".split()


@pytest.fixture(scope="module")
def install():
    """The install space. roslaunch searches the whole source tree, so it must not stay there."""
    folder = BUILD / "install"
    # catkin installs its setup files to the prefix of the configuration, whatever --prefix says.
    assert f"CMAKE_INSTALL_PREFIX:PATH={folder}\n" in (BUILD / "CMakeCache.txt").read_text()
    shutil.rmtree(folder, ignore_errors=True)
    run("cmake", "--install", BUILD)
    yield folder
    shutil.rmtree(folder)


@pytest.mark.parametrize("file", FILES)
def test_installed(install, file):
    assert (install / file).is_file()


def installed_demo(install):
    """The installed demo, and the options of run() for an environment without the source tree."""
    environment = {"HOME": os.environ["HOME"], "PATH": "/usr/bin:/bin"}
    return install / "lib/ground_scale_vo/demo", {"env": environment}


def test_demo(install, short, tmp_path):
    demo, options = installed_demo(install)
    assert_plays(demo, tmp_path, "--sequence", short, **options)


@pytest.mark.parametrize("node, program, text", [
    ("playback_monitor", None, "roslaunch cannot start [ground_scale_vo/playback_monitor]"),
    ("ground_truth_relay", "#!/bin/sh\nexit 3\n",
     "the node ground_truth_relay exited before playback finished"),
], ids=["missing", "dies"])
def test_demo_ends_when_a_node_is(install, bag, tmp_path, node, program, text):
    demo, options = installed_demo(install)
    file, original = install / "lib/ground_scale_vo" / node, tmp_path / node
    shutil.move(file, original)
    try:
        if program:
            file.write_text(program)
            file.chmod(0o755)
        done = run(demo, "--bag", bag, "--out", tmp_path, check=False, **options)
    finally:
        shutil.move(original, file)
    assert done.returncode == 1 and text in done.stdout + done.stderr, done.stdout + done.stderr


@pytest.mark.long
def test_debian_package(tmp_path):
    package = run(SCRIPTS / "package", "--out", tmp_path).stdout.splitlines()[-1]
    contents = run("dpkg-deb", "-c", package).stdout
    for file in ("/usr/lib/ground_scale_vo/demo", "/usr/include/ground_scale_vo/VoFrame.h",
                 "/usr/lib/.*/libground_scale_vo_nodelets.so",
                 "/usr/share/ground_scale_vo/nodelet_plugins.xml",
                 "/usr/share/ground_scale_vo/launch/kitti.launch",
                 "/usr/share/doc/ground-scale-vo/copyright"):
        assert re.search(rf" \.{file}$", contents, re.MULTILINE), file
    assert "setup.sh" not in contents, "the package makes /usr a workspace"
    depends = run("dpkg-deb", "-f", package, "Depends").stdout
    for name in ("libnodeletlib-tools", "libroscpp", "libopencv-core"):
        assert name in depends


def test_package_unknown_option():
    assert_refused(2, "--nonsense", SCRIPTS / "package", "--nonsense")
