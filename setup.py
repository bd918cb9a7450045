"""The Python package ground_scale_vo: docs/how-to/python.md. CMake builds its extension module."""

import os
import pathlib
import re
import subprocess
import sys

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

ROOT = pathlib.Path(__file__).resolve().parent


def pybind11_folder():
    """The argument of CMake for a pybind11 that pip has installed; it finds Debian's without."""
    try:
        import pybind11
        return [f"-Dpybind11_DIR={pybind11.get_cmake_dir()}"]
    except (ImportError, AttributeError):
        return []


class CMakeBuild(build_ext):
    """Builds the CMake target and installs the component `python` into the package."""

    def build_extension(self, ext):
        # A build folder that is already configured, for the tests, whose build has compiled the core.
        folder = os.environ.get("GROUND_SCALE_VO_PYTHON_BUILD")
        if not folder:
            folder = os.path.join(os.path.abspath(self.build_temp), "cmake")
            subprocess.check_call([
                "cmake", "-S", str(ROOT), "-B", folder, "-DGROUND_SCALE_VO_ROS=OFF",
                "-DGROUND_SCALE_VO_TOOLS=OFF", "-DGROUND_SCALE_VO_PYTHON=ON",
                f"-DPYTHON_EXECUTABLE={sys.executable}", f"-DPython3_EXECUTABLE={sys.executable}",
                *pybind11_folder()])
        subprocess.check_call(["cmake", "--build", folder, "--target", "ground_scale_vo_python",
                               "--parallel", str(os.cpu_count())])
        package = pathlib.Path(self.get_ext_fullpath(ext.name)).resolve().parent
        subprocess.check_call(["cmake", "--install", folder, "--component", "python",
                               "--prefix", str(package)])


setup(
    name="ground_scale_vo",
    version=re.search("<version>(.*)</version>", (ROOT / "package.xml").read_text())[1],
    description="Metric monocular visual odometry for a camera of known height above the road",
    license="BSD-3-Clause",
    package_dir={"": "python"},
    packages=["ground_scale_vo"],
    package_data={"ground_scale_vo": ["py.typed"]},
    ext_modules=[Extension("ground_scale_vo._core", [])],
    cmdclass={"build_ext": CMakeBuild},
    python_requires=">=3.8",
    install_requires=["numpy"],
    extras_require={"run": ["opencv-python", "pyyaml", "matplotlib", "jinja2"]},
    entry_points={"console_scripts": ["ground_scale_vo = ground_scale_vo.command_line:main"]},
    zip_safe=False,
)
