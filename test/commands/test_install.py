"""The install space and the Debian package contain everything that a run needs."""

import os
import re
import shutil

import pytest
from conftest import BUILD, ROOT, SCRIPTS, assert_played, assert_refused, run, write_program


@pytest.fixture(scope="module")
def install(tmp_path_factory):
    """The install space, outside the source tree, which roslaunch searches as a whole."""
    folder = tmp_path_factory.mktemp("install")
    run("cmake", "--install", BUILD, env={**os.environ, "DESTDIR": str(folder)})
    prefix = re.search(r"CMAKE_INSTALL_PREFIX:PATH=/(.*)", (BUILD / "CMakeCache.txt").read_text())[1]
    return folder / prefix


@pytest.fixture(scope="module")
def demo(install):
    """run() for the installed demo, in an environment without the source tree."""
    def call(*arguments, **options):
        return run(install / "lib/ground_scale_vo/demo", *arguments, **options,
                   env={"HOME": os.environ["HOME"], "PATH": "/usr/bin:/bin"})
    return call


def test_files(install):
    installed = {file.name for file in (install / "lib/ground_scale_vo").iterdir()}
    tools = {file.stem for file in (ROOT / "src/tools").glob("*.cpp")}
    nodes = {file.name for file in (ROOT / "nodes").iterdir()}
    scripts = {"demo", "evaluate", "calibrate_height", "metrics_table.py", "plot_run.py", "lib"}
    assert tools | nodes | scripts <= installed
    share = install / "share/ground_scale_vo"
    for folder in ("launch", "config", "rviz"):
        assert {file.name for file in (ROOT / folder).iterdir()} == {file.name for file in (share / folder).iterdir()}
    for file in (share / "package.xml", share / "nodelet_plugins.xml", install / "include/ground_scale_vo/VoFrame.h",
                 install / "include/ground_scale_vo/scale/scale_recovery.hpp"):
        assert file.is_file()


def test_demo(demo, short, tmp_path):
    assert_played(demo("--out", tmp_path, "--sequence", short).stdout, tmp_path / "short")


@pytest.mark.parametrize("node, program, text", [
    ("playback_monitor", None, "roslaunch cannot start [ground_scale_vo/playback_monitor]"),
    ("ground_truth_relay", "exit 3", "the node ground_truth_relay exited before playback finished"),
], ids=["missing", "dies"])
def test_demo_ends_when_a_node_is(install, demo, bag, tmp_path, node, program, text):
    file, original = install / "lib/ground_scale_vo" / node, tmp_path / node
    shutil.move(file, original)
    try:
        if program:
            write_program(file, program)
        done = demo("--bag", bag, "--out", tmp_path, check=False)
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
