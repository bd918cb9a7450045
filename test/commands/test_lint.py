"""The lint scripts report violations and accept the source tree; clang finds a command for each file."""

import json
import shutil

import pytest
from conftest import BUILD, ROOT, SCRIPTS, run

DEPENDENCIES = SCRIPTS / "lint/dependencies.py"


@pytest.fixture
def tree(tmp_path):
    for folder in ("include", "src", "test"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    return tmp_path


def test_dependencies_hold(tree):
    run("/usr/bin/python3", DEPENDENCIES, tree)


@pytest.mark.parametrize("file, include", [
    ("src/common/x.cpp", '"ground_scale_vo/vo/vo_frame.hpp"'),
    ("src/vo/x.cpp", '"ground_scale_vo/scale/scale_recovery.hpp"'),
    ("src/scale/x.cpp", '"ground_scale_vo/vo/visual_odometry.hpp"'),
    ("include/ground_scale_vo/vo/x.hpp", '"ground_scale_vo/metric_odometry.hpp"'),
    ("src/metric_odometry.cpp", '"ground_scale_vo/io/text_file.hpp"'),
    ("src/ros/x.cpp", '"ground_scale_vo/nodelets/x.hpp"'),
    ("src/nodelets/x.cpp", '"ground_scale_vo/simulation/synthetic_drive.hpp"'),
    ("src/io/x.cpp", '"ground_scale_vo/ros/conversions.hpp"'),
    ("src/evaluation/x.cpp", '"../simulation/synthetic_street.hpp"'),
    ("src/common/x.cpp", "<ros/time.h>"),
    ("src/vo/x.cpp", "<sensor_msgs/Image.h>"),
    ("src/scale/x.cpp", '"ground_scale_vo/VoFrame.h"'),
    ("src/simulation/x.cpp", "<rosbag/bag.h>"),
    ("test/scale/x_test.cpp", "<tf2/buffer_core.h>"),
    ("test/tools/x_test.cpp", "<ros/time.h>"),
    ("src/new_module/x.cpp", "<vector>"),
])
def test_violated_dependency(tree, file, include):
    path = tree / file
    path.parent.mkdir(exist_ok=True)
    with path.open("a", encoding="utf-8") as stream:
        stream.write(f"#include {include}\n")
    done = run("/usr/bin/python3", DEPENDENCIES, tree, check=False)
    assert done.returncode == 1 and f"{file}: " in done.stdout


def test_broken_link(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# A heading\n[a](#a-heading) [b](page.md#a-heading) [c](https://example.org)\n")
    run("/usr/bin/python3", SCRIPTS / "lint/links.py", page)
    page.write_text("[a](#none)\n[b](none.md)\n")
    done = run("/usr/bin/python3", SCRIPTS / "lint/links.py", page, check=False)
    assert done.returncode == 1 and done.stdout.splitlines() == [f"{page}: #none", f"{page}: none.md"]


def test_clang_has_a_command_for_each_source():
    commands = json.loads((BUILD / "clang/compile_commands.json").read_text())
    files = {entry["file"] for entry in commands}
    assert {str(path) for path in (ROOT / "src").rglob("*.cpp")} <= files
    assert not any("cmake_pch" in entry["command"] for entry in commands if "/src/" in entry["file"])
