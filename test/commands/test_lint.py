"""The lint scripts report violations and accept the source tree; clang finds a command for each file."""

import json
import re
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


PATCH = """\
--- a/src/common/error.cpp
+++ b/src/common/error.cpp
@@ -1,3 +1,3 @@
-#include "ground_scale_vo/common/error.hpp"
+#include <cassert>
 
 #include <sstream>
"""


@pytest.mark.parametrize("text, error", [
    ("The header is wrong.\n\n" + PATCH, None),
    ("The header is wrong.\nSurvives: it is not read.\n\n" + PATCH, None),
    ("The header is wrong.\n\n" + PATCH.replace("error.hpp", "old_name.hpp"), "does not apply"),
    (PATCH, "begins with a sentence"),
    ("no sentence\n\n" + PATCH, "begins with a sentence"),
    ("The header is wrong.\nSurvives:\n\n" + PATCH, "needs a reason"),
    ("The header is wrong.\n\n" + PATCH.replace("src/common", "test/common"), "src/ or include/"),
    ("The header is wrong.\n", "src/ or include/"),
])
def test_mutation_that_cannot_be_used(tmp_path, text, error):
    """In a tree of one module, with few of the patches."""
    for folder in ("include/ground_scale_vo/common", "src/common", "test/mutations/common"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    path = tmp_path / "test/mutations/common/new.patch"
    path.write_text(text, encoding="utf-8")
    (tmp_path / "scripts/lib").mkdir(parents=True)
    script = shutil.copy(SCRIPTS / "lib/mutate.py", tmp_path / "scripts/lib")
    done = run("/usr/bin/python3", "-B", script, "--check", check=False)
    assert done.returncode == (1 if error else 0), done.stdout
    assert error is None or (f"{path}: " in done.stdout and error in done.stdout)


def test_clang_has_a_command_for_each_source():
    commands = json.loads((BUILD / "clang/compile_commands.json").read_text())
    files = {entry["file"] for entry in commands}
    assert {str(path) for path in (ROOT / "src").rglob("*.cpp")} <= files
    assert not any("cmake_pch" in entry["command"] for entry in commands if "/src/" in entry["file"])


@pytest.fixture
def cited(tmp_path):
    """A copy of the files that cite figures."""
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    for name in ("README.md", "CONTRIBUTING.md"):
        shutil.copy(ROOT / name, tmp_path)
    return tmp_path


def figures(root, *arguments, check=False):
    return run("/usr/bin/python3", SCRIPTS / "lint/figures.py", *arguments, root, check=check)


@pytest.mark.parametrize("file, pattern, replacement, reason", [
    ("README.md", r"(<!--=tables.sequences-->.*?\| 0\.)\d", r"\g<1>x", "differs from"),
    ("docs/explanation/accuracy.md", r"(<!--=summary.drives-->)", r"\1 ", "differs from"),
    ("docs/reference/reliability.md", r"faults\.violated", "faults.none", "no figure faults.none"),
    ("docs/results.md", r"\d\.\d\d", "0.1", "docs/results.md: differs from"),
    ("docs/results.json", r'"max_error_percent"', '"other"', "no figure faults.max_error_percent"),
    ("docs/results.json", r'"cpu_ms_per_frame"', '"other"', "missing"),
    ("docs/results.json", r'"rle_percent": \d', '"rle_percent": 7', "differs from"),
    ("docs/explanation/experiments.md", r"\*Experiments of", "Experiments of", "table without a source"),
    ("README.md", r"\Z", "\n| RLE |\n|---|\n| 0.43 |\n", "README.md: a table without a source"),
])
def test_figures(cited, file, pattern, replacement, reason):
    path = cited / file
    text = path.read_text()
    changed = re.sub(pattern, replacement, text, count=1, flags=re.DOTALL)
    assert changed != text
    path.write_text(changed)
    done = figures(cited)
    assert done.returncode == 1 and reason in done.stdout + done.stderr


def test_figures_are_written(cited):
    figures(cited, check=True)
    results = cited / "docs/results.json"
    results.write_text(re.sub(r'"rle_percent": [\d.]+', '"rle_percent": 77.0', results.read_text()))
    figures(cited, "--write")
    figures(cited, check=True)
    assert "| 77.00 |" in (cited / "README.md").read_text()
    assert "| 77.00 |" in (cited / "docs/results.md").read_text()
