"""The install space and the Debian package contain everything that a run needs."""

import os
import re

import pytest
from conftest import BUILD, ROOT, SCRIPTS, assert_played, run


@pytest.fixture(scope="module")
def install(tmp_path_factory):
    """The install space, outside the source tree, which roslaunch searches as a whole."""
    folder = tmp_path_factory.mktemp("install")
    run("cmake", "--install", BUILD, env={**os.environ, "DESTDIR": str(folder)})
    prefix = re.search(r"CMAKE_INSTALL_PREFIX:PATH=/(.*)", (BUILD / "CMakeCache.txt").read_text())[1]
    return folder / prefix


def test_files(install):
    expected = [f"lib/ground_scale_vo/{name}" for name in (
        "calibrate_height", "demo", "evaluate", "lib", "metrics_table.py", "plot_run.py", "presets.py", "presets.yaml", "run_page.py", "run_page.html",
        "run_sequence",
        *(file.name for file in (ROOT / "nodes").iterdir() if file.is_file()))]
    expected += [f"share/ground_scale_vo/{file.relative_to(ROOT)}" for folder in ("launch", "config", "rviz")
                 for file in (ROOT / folder).iterdir()]
    expected += ["share/ground_scale_vo/nodelet_plugins.xml", "include/ground_scale_vo/VoFrame.h",
                 "include/ground_scale_vo/scale/scale_recovery.hpp"]
    assert not [file for file in expected if not (install / file).exists()]
    # The package of the messages finds the Python module.
    messages = install / "lib/python3/dist-packages/ground_scale_vo/__init__.py"
    assert messages.read_text() == (ROOT / "python/ground_scale_vo/__init__.py").read_text()


def test_demo_without_the_source_tree(install, short, tmp_path):
    done = run(install / "lib/ground_scale_vo/demo", "--out", tmp_path, "--sequence", short, "--preset", "kitti",
               env={"HOME": os.environ["HOME"], "PATH": "/usr/bin:/bin"})
    assert_played(done.stdout, tmp_path / "short")


def test_calibrate_camera_without_the_source_tree(install, short, tmp_path):
    run(install / "lib/ground_scale_vo/calibrate_camera", short, "--out", tmp_path / "camera.yaml",
        env={"HOME": os.environ["HOME"], "PATH": "/usr/bin:/bin"})
    assert (tmp_path / "camera.yaml").exists()


def test_another_package_uses_messages_and_library(install, tmp_path):
    run("cmake", "-S", ROOT / "test/downstream", "-B", tmp_path, f"-DCMAKE_PREFIX_PATH={install}",
        "-DPYTHON_EXECUTABLE=/usr/bin/python3")
    run("cmake", "--build", tmp_path)
    assert (tmp_path / "devel/lib/downstream/path_length").exists()


@pytest.mark.long
def test_debian_package():
    package = run(SCRIPTS / "package", timeout=None).stdout.splitlines()[-1]
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
