#!/usr/bin/python3
"""Checks the dependency direction between the modules in the #include lines below a source tree.

usage: scripts/lint/dependencies.py [ROOT]
"""

import pathlib
import re
import sys

# Module: what it may include besides itself, a module or one header. Runtime modules first, then tooling.
ALLOWED = {
    "common": [],
    "input": ["common"],
    "vo": ["common", "input/camera.hpp"],
    "scale": ["common", "input/camera.hpp", "vo/vo_frame.hpp"],
    "lens": ["common", "input", "vo/vo_frame.hpp"],
    "self_calibrating_odometry": ["common", "input", "vo", "lens"],
    "metric_odometry": ["common", "input", "vo", "scale", "lens", "self_calibrating_odometry"],
    "ros": ["common", "input", "vo", "scale", "lens", "self_calibrating_odometry", "metric_odometry"],
    "io": ["common", "input"],
    "evaluation": ["common", "input", "lens", "vo", "scale", "metric_odometry", "io", "calibration"],
    "calibration": ["common", "input", "lens", "vo"],
    "simulation": ["common", "input", "vo", "scale", "metric_odometry", "io", "evaluation"],
    "ros_tools": ["common", "input", "vo", "scale", "metric_odometry", "ros", "io", "evaluation"],
    "tools": ["common", "input", "lens", "vo", "scale", "metric_odometry", "ros", "io", "evaluation", "calibration",
              "simulation", "ros_tools"],
}
USES_ROS = {"ros", "ros_tools", "tools"}
TESTS_WITHOUT_ROS = (set(ALLOWED) - USES_ROS) | {"drives", "integration", "support", "tools"}

INCLUDE = re.compile(r'^\s*#\s*include\s+[<"]([^>"]+)[>"]', re.MULTILINE)
OWN = re.compile(rf"(?:ground_scale_vo/|(?:\.\./)+(?:src/)?|)((?:{'|'.join(ALLOWED)})(?:/.*|\.hpp))$")
ROS = re.compile(
    r"(ros|tf2\w*|tf|nodelet|pluginlib|class_loader|image_transport|rosbag"
    r"|pcl_conversions|pcl_ros|message_filters|diagnostic_updater|topic_tools|\w+_msgs|std_srvs)/"
    r"|ground_scale_vo/[A-Z]\w*\.h$")  # the last: generated from msg/


def sources(folder):
    return sorted(path for path in folder.rglob("*") if path.suffix in (".cpp", ".hpp", ".h"))


def module_of(path):
    """The first part of a path: a folder, or the name of a single file."""
    return pathlib.PurePath(path).parts[0].split(".")[0]


def may_include(module, header):
    return any(header == allowed or module_of(header) == allowed
               for allowed in [module] + ALLOWED[module])


def violations(root):
    for base in (root / "include/ground_scale_vo", root / "src", root / "simulation"):
        for file in sources(base):
            module = module_of(file.relative_to(base))
            name = file.relative_to(root)
            if base.name == "simulation" and module != "tools":
                module = "simulation"
            if module not in ALLOWED:
                yield f"{name}: the module {module} is missing in the table of this script"
                continue
            for header in INCLUDE.findall(file.read_text()):
                own = OWN.match(header)
                if own and not may_include(module, own[1]):
                    yield f"{name}: {module} must not include {header}"
                if module not in USES_ROS and ROS.match(header):
                    yield f"{name}: {module} must not include ROS ({header})"
    for file in sources(root / "test"):
        module = module_of(file.relative_to(root / "test"))
        for header in INCLUDE.findall(file.read_text()):
            own = OWN.match(header)
            # Not tools: the tests of tools include tools/support, which is built without ROS.
            uses_ros = ROS.match(header) or (own and module_of(own[1]) in USES_ROS - {"tools"})
            if module in TESTS_WITHOUT_ROS and uses_ros:
                yield f"{file.relative_to(root)}: tests of {module} must not include ROS ({header})"


def main():
    default = pathlib.Path(__file__).resolve().parents[2]
    root = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else default
    found = list(violations(root))
    print("\n".join(found))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
