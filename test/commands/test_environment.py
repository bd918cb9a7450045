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


def test_failed_build_names_its_log(tmp_path):
    """Also when the log has none of the words of a compiler's error."""
    result = subprocess.run(
        ["bash", "-c", f"set -e; unset GROUND_SCALE_VO_BUILD; source {SCRIPTS}/lib/environment.sh; mkdir build; "
                       "gsv_use_build $PWD/build; gsv_source_distribution() { :; }; "
                       "cmake() { if [[ $1 == --build ]]; then echo 'Fehler 1'; return 1; fi; }; gsv_build x"],
        cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 1
    assert "Fehler 1" in result.stderr and f"build: failed, see {tmp_path}/build/build.log\n" in result.stderr


@pytest.mark.parametrize("command", ["evaluate none", "demo --bag none", "report none", "benchmark none"])
def test_cdpath_has_no_effect(command):
    """With it, cd prints the folder."""
    def outcome(**variables):
        environment = {name: value for name, value in os.environ.items() if name != "CDPATH"}
        done = subprocess.run([f"scripts/{command.split()[0]}", *command.split()[1:]], cwd=ROOT,
                              env={**environment, **variables}, capture_output=True, text=True)
        return done.returncode, done.stderr
    expected = outcome()
    assert expected[0] in (1, 2) and "none" in expected[1]
    assert outcome(CDPATH=".") == expected
