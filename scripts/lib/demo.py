"""Plays a bag through both nodelets, evaluates and plots the result.

Starts a ROS master and both nodelets, plays a bag, and at its end prints a table of one row with the metrics and
plots trajectory and scale. Installs missing packages and builds first. Without arguments it plays a short rendered
drive.

Files in DIR/<name>/: docs/reference/commands.md, "Output files".
Exit status: 0 done, 1 the data are unusable or a node failed, 2 wrong arguments, 130 interrupted.
"""

import argparse
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
import time

from environment import LIB, Parser, build, private_master, run

# What the demo runs.
TARGETS = ("ground_scale_vo_generate_messages", "ground_scale_vo_nodelets", "render_drive", "kitti_to_bag",
           "ground_truth_relay", "evaluate_bag")
PROGRESS_PERIOD_S = 10  # in a log; on a terminal one line is overwritten
USUAL_HEIGHTS_M = 0.2, 5.0  # as in scale_options.hpp; the launch files have no unusual_height
OUTPUTS = ("recorded.bag", "roslaunch.log", "metrics.json", "run.json", "poses.txt", "poses_unscaled.txt", "ground_truth.txt",
           "trajectory_tum.txt", "scale.csv", "timing.csv", "trajectory.png", "scale.png", "timing.png", "report.html")


def positive(text):
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


def height(text):
    value, (least, largest) = positive(text), USUAL_HEIGHTS_M
    if not least <= value <= largest:
        raise argparse.ArgumentTypeError(f"camera_height is {value:g} m, on a road vehicle it is {least:g} to {largest:g} m: "
                                         "is it in centimetres?")
    return value


def path(text):
    return pathlib.Path(text).resolve()  # roslaunch and its nodes have other working folders


def parse():
    parser = Parser("demo", __doc__)
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--bag", nargs="+", type=path, default=[], metavar="FILE",
                        help="play this bag, or the parts of a split recording: --bag drive_*.bag")
    source.add_argument("--sequence", type=path, metavar="DIR", help="convert this KITTI folder to a bag and play it")
    height_of = parser.add_mutually_exclusive_group()
    height_of.add_argument("--camera-height", type=height, metavar="M",
                           help="height of the camera above the road [m] (default without --speed: 1.65, as in KITTI and in "
                           "the rendered drive; required with other topics than those of /kitti)")
    height_of.add_argument("--preset", default="", metavar="NAME",
                           help="known camera, such as kitti or nuscenes (docs/tutorials/your_camera.md): its height with "
                           "the standard deviation")
    parser.add_argument("--speed", default="", metavar="TOPIC",
                        help="speed of the vehicle in the bag: Odometry, TwistStamped or TwistWithCovarianceStamped, or with "
                        "--speed-unit Float32 or Float64; of the clock of the images, as only `ground_scale_vo run` "
                        "has a --speed-offset")
    parser.add_argument("--speed-unit", default="", choices=("mps", "kmh", "mph", "knots", "mmps"),
                        help="its unit (default: m/s)")
    parser.add_argument("--rate", type=positive, default=1.0, metavar="R",
                        help="playback rate relative to the recording (default 1)")
    parser.add_argument("--rviz", action="store_true", help="start rviz; without a display the run continues without it")
    parser.add_argument("--out", type=path, default=path("results"), metavar="DIR",
                        help="results go to DIR/<name>/ (default: results); <name> is that of the (first) bag or of the "
                        "folder, or demo")
    parser.add_argument("--image", default="", metavar="TOPIC",
                        help="images of the bag, raw or compressed (default: image_rect, image_raw or image of "
                        "/kitti/camera_gray_left, whichever the bag has); TOPIC/compressed is used where the bag has only that")
    parser.add_argument("--camera-info", default="", metavar="TOPIC",
                        help="their calibration (default: camera_info beside the images)")
    parser.add_argument("--rectified", action="store_true", default=None,
                        help="the images are rectified, and P of camera_info is their projection (default: topics of /kitti)")
    parser.add_argument("--unrectified", action="store_false", dest="rectified",
                        help="the images are distorted, as K and D describe")
    calibration = parser.add_mutually_exclusive_group()
    calibration.add_argument("--camera", type=path, metavar="FILE",
                             help="YAML of camera_calibration or scripts/calibrate_camera that describes the images as they come, "
                             "instead of camera_info")
    calibration.add_argument("--fov", type=positive, metavar="DEG",
                             help="horizontal field of view of the lens [degrees], when there is no calibration: the lens is estimated from "
                             "the bag first, which needs turns, as by scripts/calibrate_camera")
    parser.add_argument("--mask", type=path, metavar="FILE",
                        help="image of the size of the bag's images, black where they never show the scene (hood, watermark)")
    parser.add_argument("--base-frame", default="", metavar="FRAME",
                        help="frame whose pose is published (default: the image's frame)")
    parser.add_argument("--yes", action="store_true", help="install missing packages without a question")
    arguments = parser.parse_args()
    check(parser, arguments)
    return arguments


def check(parser, arguments):
    if arguments.speed_unit and not arguments.speed:
        parser.error("--speed-unit is for --speed")
    if arguments.speed and not arguments.bag:
        parser.error("--speed is for --bag")
    if arguments.preset:
        sys.path.insert(0, str(LIB.parent))
        import presets
        try:
            arguments.camera_height = presets.preset(arguments.preset)["camera_height"]
        except ValueError as error:
            parser.error(str(error))
    if arguments.camera_height is None and not arguments.speed:
        if arguments.image and not arguments.image.lstrip("/").startswith("kitti/"):
            parser.error(f"--image {arguments.image} needs --camera-height or --preset, which scales all distances")
        arguments.camera_height = 1.65
    for what, paths in (("bag", arguments.bag), ("file", filter(None, (arguments.camera, arguments.mask)))):
        for file in paths:
            if not file.is_file():
                parser.error(f"there is no {what} {file}", status=1)
    if arguments.sequence and not arguments.sequence.is_dir():
        parser.error(f"there is no folder {arguments.sequence}", status=1)
    if arguments.sequence:
        arguments.name = arguments.sequence.name
    else:
        arguments.name = arguments.bag[0].stem if arguments.bag else "demo"
    results = arguments.results = arguments.out / arguments.name
    if arguments.sequence and results.exists() and results.samefile(arguments.sequence):
        parser.error(f"--out would write the results into the sequence's own folder {arguments.sequence}")
    recorded = results / "recorded.bag"
    for bag in arguments.bag:
        if recorded.exists() and recorded.samefile(bag):
            parser.error(f"--out would write recorded.bag over the bag {bag}")
    if arguments.fov:
        arguments.camera = results / "lens.yaml"
    if arguments.rviz and not os.environ.get("DISPLAY"):
        print("demo: there is no display, so rviz is not started; set DISPLAY, or use xvfb-run", file=sys.stderr)
        arguments.rviz = False


class Display:
    """Reduces the output of bag.launch to the address of the master, progress, warnings and the first error: those
    that follow only result from the shutdown."""

    def __init__(self, launch, name, master, recorded):
        self._launch, self._name, self._master = launch, name, master
        self._is_terminal = sys.stderr.isatty()
        self._next_progress = 0.0
        self.failed = False
        self._messages = [  # pattern of a line, text, and whether it is an error that ends the run
            (r".*playback_monitor: (.*)", "playback_monitor: %s", True),
            (r".*cannot launch node of type (.*)", f"{name}: roslaunch cannot start %s", True),
            (r"=+REQUIRED process \[(bag_recorder)-.* has died!",
             f"{name}: {recorded} cannot be written: %s stopped; is the disk full?", True),
            # The monitor has not ended regularly, nor explained its end.
            (r"=+REQUIRED process \[(?!playback_monitor)(.*)-\d+\] has died!",
             f"{name}: the node %s exited before playback finished", True),
            (r"\[(rviz)-.*process has died",
             f"{name}: %s could not open its window on the display '{os.environ.get('DISPLAY')}', or crashed; the run "
             "continues without it", False),
            (r".*?(\[(?: WARN|ERROR|FATAL)\].*)", "%s", False)]  # a node may have begun the line

    def follow(self, stream):
        for line in stream:
            if not self.failed:
                self._read(re.sub(r"\x1b\[[0-9;]*m", "", line).rstrip("\n"))
        if self._is_terminal:
            print(file=sys.stderr)

    def _show(self, text, end="\n"):
        clear = "\r\x1b[K" if self._is_terminal else ""  # overwrites the progress
        print(clear + text, end=end, file=sys.stderr, flush=True)

    def _read(self, line):
        _, is_progress, progress = line.partition("progress: ")  # roslaunch may have written before it on the same line
        if is_progress:
            if not self._next_progress:
                self._show(f"{self._name}: ROS_MASTER_URI={self._master}")
            if self._is_terminal or time.monotonic() >= self._next_progress:
                self._next_progress = time.monotonic() + PROGRESS_PERIOD_S
                self._show(f"{self._name}: {progress}", end="" if self._is_terminal else "\n")
            return
        for pattern, text, is_error in self._messages:
            found = re.match(pattern, line)
            if found:
                self._show(text % found[1])
                self.failed = is_error
                if "cannot launch" in line:  # roslaunch continues without the node, even when it is required
                    self._launch.terminate()
                return


def kill_nodes(master):
    """Kills the processes of a private master. When roslaunch is killed, or when a required node dies while it still
    starts others, the master and some nodes remain."""
    for process in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            variables = (process / "environ").read_text(errors="replace").split("\0")
            if {f"ROS_MASTER_URI={master}", f"ROS_MASTER_URI={master}/"} & {*variables}:  # with a slash by roslaunch
                os.kill(int(process.name), signal.SIGKILL)
        except OSError:  # of another user, or ended
            pass


def launch_words(bags, arguments):
    """The launch file, with its arguments, for roslaunch."""
    options = {
        "required": "true", "bag": " ".join(shlex.quote(str(bag)) for bag in bags), "image": arguments.image,
        "camera_height": "" if arguments.preset else arguments.camera_height or "", "preset": arguments.preset, "speed": arguments.speed, "speed_unit": arguments.speed_unit,
        "camera_info": arguments.camera_info, "rate": arguments.rate, "rviz": str(arguments.rviz).lower(),
        "base_frame": arguments.base_frame, "mask": arguments.mask or "", "camera_file": arguments.camera or "",
        "record": arguments.results / "recorded.bag"}
    if arguments.rectified is not None:
        options["image_is_rectified"] = str(arguments.rectified).lower()
    is_kitti = arguments.image == "" or arguments.image.lstrip("/").startswith("kitti/")
    file = "kitti.launch" if is_kitti else "bag.launch"
    return ["ground_scale_vo", file, *(f"{name}:={value}" for name, value in options.items())]


def require_playable(tools, bags, arguments):
    """Ends the demo when the bags themselves show that the nodelets cannot use them."""
    parameters = subprocess.run(["roslaunch", "--dump-params", *launch_words(bags, arguments)], stdout=subprocess.PIPE, check=True)
    modules = os.pathsep.join(filter(None, (os.environ.get("PYTHONPATH"), str(tools / "python"))))
    checked = subprocess.run([tools / "playback_monitor", "--check"], input=parameters.stdout, stderr=subprocess.PIPE,
                             env={**os.environ, "PYTHONPATH": modules})
    if checked.returncode:
        sentence = checked.stderr.decode(errors="replace").strip().splitlines()[-1]
        options = re.sub(r"\b[a-z_]+:=", lambda name: f"--{name[0][:-2].replace('_', '-')} ", sentence)
        sys.exit(f"demo: {options}")


def play(bags, arguments):
    """True if the bag was played to its end."""
    results = arguments.results
    port, environment = private_master()
    launch = subprocess.Popen(["roslaunch", "-p", port, *launch_words(bags, arguments)], stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, env=environment)
    log = results / "roslaunch.log"
    tee = subprocess.Popen(["tee", log], stdin=launch.stdout, stdout=subprocess.PIPE, text=True, errors="replace",
                           start_new_session=True)  # the log is complete also after Ctrl-C
    display = Display(launch, arguments.name, environment["ROS_MASTER_URI"], results / "recorded.bag")
    follower = threading.Thread(target=display.follow, args=[tee.stdout])
    follower.start()
    try:
        launch.wait()
    finally:
        launch.terminate()  # on SIGTERM roslaunch stops its nodes
        launch.wait()
        kill_nodes(environment["ROS_MASTER_URI"])
        follower.join()
    if "Playback finished: " in log.read_text(errors="replace"):
        return True
    for name in ("recorded.bag", "recorded.bag.active"):
        (results / name).unlink(missing_ok=True)
    if not display.failed:
        print(f"demo: the run ended before the bag, see {log}", file=sys.stderr)
    return False


def main():
    arguments = parse()
    if arguments.yes:
        os.environ["GROUND_SCALE_VO_YES"] = "1"
    tools = build(*TARGETS, packages=["rviz"])  # documented commands use it, too
    results, bags = arguments.results, arguments.bag
    if bags:
        require_playable(tools, bags, arguments)
    try:
        results.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        sys.exit(f"demo: the folder {results} cannot be written to ({error.strerror})")
    with tempfile.TemporaryDirectory(prefix="ground_scale_vo_demo.") as work:
        sequence = arguments.sequence
        if not bags and not sequence:
            sequence = pathlib.Path(work) / "demo"
            subprocess.run([tools / "render_drive", sequence], check=True)
        if sequence:
            bags = [pathlib.Path(work) / f"{arguments.name}.bag"]
            subprocess.run([tools / "kitti_to_bag", sequence, "--out", bags[0]], check=True)
        if arguments.fov:
            subprocess.run([LIB.parent / "calibrate_camera", *bags, "--fov", str(arguments.fov), "--out", arguments.camera, "--force",
                            *(["--image", arguments.image] if arguments.image else []),
                            *(["--mask", arguments.mask] if arguments.mask else [])], check=True)
        for name in OUTPUTS:  # of an earlier run
            (results / name).unlink(missing_ok=True)
        if not play(bags, arguments):
            return 1
        evaluation = [tools / "evaluate_bag", "--played", *bags, *(["--image", arguments.image] if arguments.image else [])]
        evaluated = subprocess.run(
            [*evaluation, "--recorded", results / "recorded.bag", "--out", results,
             *(["--camera-height", str(arguments.camera_height)] if arguments.camera_height else [])],
            stderr=subprocess.PIPE, text=True)
        if (results / "metrics.json").exists():  # also when they are no result
            subprocess.run([tools / "metrics_table.py", results], check=True)
            subprocess.run([tools / "plot_run.py", results], check=True)
            subprocess.run([tools / "run_page.py", results, "--command", shlex.join(["scripts/demo", *sys.argv[1:]]),
                            "--images", shlex.join(map(str, evaluation))], check=True)
            print(f"results and plots: {results}")
    print(evaluated.stderr, end="", file=sys.stderr, flush=True)
    return evaluated.returncode


if __name__ == "__main__":
    run(main)
