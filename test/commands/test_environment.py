"""scripts/lib/environment.sh: the packages and the build that the commands use."""

import os
import re
import shutil
import subprocess

import pytest
from conftest import BUILD, ROOT, SCRIPTS, assert_plays, run


@pytest.mark.serial
def test_workspace_is_not_built_again(short, tmp_path):
    """rosrun starts the scripts in the source space of a workspace, whose devel space is used."""
    source, devel = tmp_path / "src/ground_scale_vo", tmp_path / "devel"
    shutil.copytree(SCRIPTS, source / "scripts")
    shutil.copy(ROOT / "CMakeLists.txt", source)
    (devel / "lib").mkdir(parents=True)
    (devel / "lib/ground_scale_vo").symlink_to(BUILD / "devel/lib/ground_scale_vo")
    (devel / ".catkin").write_text(str(tmp_path / "src"))
    (devel / "setup.bash").write_text(f"source {BUILD}/devel/setup.bash\n")
    environment = {**os.environ, "CMAKE_PREFIX_PATH": f"{devel}:{os.environ['CMAKE_PREFIX_PATH']}"}
    del environment["GROUND_SCALE_VO_BUILD"]
    assert_plays(source / "scripts/demo", tmp_path, "--sequence", short, env=environment)
    assert not (source / "build").exists()


def documented_commands():
    pages = [ROOT / "README.md", *ROOT.glob("docs/**/*.md")]
    text = "\n".join(page.read_text() for page in pages)
    return sorted(set(re.findall(r"(?m)(?:`|^)(ros(?:bag|core|launch|node|param|run|service|topic)|rviz)\b", text)))


@pytest.mark.skipif(os.path.isdir("/opt/ros"), reason="ROS is not installed from Debian")
@pytest.mark.parametrize("command", documented_commands())
def test_documented_command_is_installed(command):
    """scripts/test has installed the packages of scripts/demo."""
    assert shutil.which(command)


@pytest.mark.parametrize("module", ["diagnostic_msgs", "visualization_msgs"])
def test_rostopic_can_print(module):
    run("/usr/bin/python3", "-c", f"import {module}.msg")


@pytest.mark.skipif(os.path.isdir("/opt/ros"), reason="the user installs the dependencies there")
def test_missing_packages_are_only_named_on_request():
    result = subprocess.run(
        ["bash", "-c", f"source {SCRIPTS}/lib/environment.sh; gsv_packages() {{ echo no-such-package; }}; gsv_setup"],
        env={**os.environ, "GROUND_SCALE_VO_NO_INSTALL": "1"}, capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (1, "set-up: 1 packages are missing: no-such-package\n")
