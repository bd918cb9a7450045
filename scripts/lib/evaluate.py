"""Runs the odometry over KITTI folders without a ROS master (deterministic, every frame, as fast as possible), plots
the results, and prints one table over all of them. Installs missing packages and builds first.

  scripts/evaluate SEQ... [--camera FILE] [--mask FILE] [--fps HZ] [--options FILE] [--set GROUP/NAME=VALUE]... [--unrectified]
                   [--refine-camera] [--smooth] [--strict]

passes these options to run_sequence: see run_sequence --help.

  scripts/evaluate --scenarios [NAME...] [--ablation] [options]

renders drives that are difficult for a camera (traffic, night, puddles, bumps ...), with exact ground truth, and
runs over them: see evaluate_scenarios --help. With the NAME faults: drives with a fault of the camera or an obstacle
that hides the road.

Files in DIR/<name>/: docs/reference/commands.md, "Output files".
Exit status: 0 all done, 1 a sequence failed (the others are still run), 2 wrong arguments.
"""

import argparse
import concurrent.futures
import functools
import os
import pathlib
import shlex
import subprocess
import sys

from environment import Parser, build, run


class Forward(argparse.Action):
    """An option of run_sequence."""

    def __call__(self, parser, namespace, values, option_string=None):
        namespace.options = [*namespace.options, option_string, *values]


def parse():
    parser = Parser("evaluate", __doc__)
    parser.add_argument("sequences", nargs="*", type=pathlib.Path, metavar="SEQ",
                        help="KITTI odometry folder, KITTI raw synced drive, or, with --camera, any folder of images with "
                        "times.txt (docs/reference/commands.md, \"Input files\"). Errors are computed only with ground "
                        "truth")
    parser.add_argument("--camera-height", default="1.65", metavar="M",
                        help="of the camera above the road [m]. Default 1.65, the height in all KITTI sequences and the "
                        "default of render_drive")
    parser.add_argument("--out", type=pathlib.Path, default="results", metavar="DIR",
                        help="results go to DIR/<name of SEQ>/ (default: results)")
    parser.add_argument("--threads", type=int, choices=range(1, 1000), default=2, metavar="N",
                        help="sequences processed at once (default 2). The times in timing.csv are valid only if N is at "
                        "most the number of idle cores")
    for name in ("--camera", "--mask", "--fps", "--options", "--set"):
        parser.add_argument(name, action=Forward, dest="options", default=[], nargs=1, help=argparse.SUPPRESS)
    for name in ("--unrectified", "--refine-camera", "--smooth", "--strict"):
        parser.add_argument(name, action=Forward, dest="options", default=[], nargs=0, help=argparse.SUPPRESS)
    arguments = parser.parse_intermixed_args()
    if not arguments.sequences:
        parser.error("SEQ is missing, see --help")
    arguments.sequences = [pathlib.Path(os.path.abspath(sequence)) for sequence in arguments.sequences]
    names = [sequence.name for sequence in arguments.sequences]
    if len({*names}) < len(names):
        parser.error(f"two of {', '.join(names)} have the same name and would share a folder of results")
    return arguments


def scenarios(options):
    tools = build("evaluate_scenarios")
    for name, default in (("--out", "results"), ("--threads", "2")):
        if name not in options:
            options += [name, default]
    if "--ablation" in options:
        options += ["--paper", pathlib.Path(__file__).resolve().parents[2] / "config/paper.yaml"]
    return subprocess.run([tools / "evaluate_scenarios", *options], check=False).returncode


def evaluate(tools, arguments, options, stderr, sequence):
    """The odometry, then plots and page, also of a drive that can be used only in part. A failed run leaves no metrics
    of an earlier one. Returns whether all was done."""
    results = arguments.out / sequence.name
    (results / "metrics.json").unlink(missing_ok=True)
    succeeded = not subprocess.run([tools / "run_sequence", sequence, *options], stderr=stderr, check=False).returncode
    if not (results / "metrics.json").exists():
        return False
    images = [str(word) for word in (tools / "run_sequence", sequence, "--camera-height", arguments.camera_height,
                                     *arguments.options)]
    for command in ([tools / "plot_run.py", results],
                    [tools / "run_page.py", results, "--command", shlex.join(["scripts/evaluate", *sys.argv[1:]]),
                     "--images", shlex.join(images)]):
        succeeded &= not subprocess.run(command, stderr=stderr, check=False).returncode
    return succeeded


def main():
    if sys.argv[1:2] == ["--scenarios"]:
        return scenarios(sys.argv[2:])
    arguments = parse()
    tools = build("run_sequence")
    options = ["--camera-height", arguments.camera_height, "--out", arguments.out, *arguments.options]
    # Wrong options end the command here, with status 2, instead of every run.
    check = subprocess.run([tools / "run_sequence", arguments.sequences[0], *options, "--check"], check=False)
    if check.returncode:
        return check.returncode
    one_by_one = arguments.threads == 1 or len(arguments.sequences) == 1
    # Progress lines of several runs would overwrite each other: only a single run has the terminal.
    with subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=sys.stderr) as stderr, \
            concurrent.futures.ThreadPoolExecutor(arguments.threads) as pool:
        one = functools.partial(evaluate, tools, arguments, options, None if one_by_one else stderr.stdin)
        done = list(pool.map(one, arguments.sequences))
    finished = [arguments.out / sequence.name for sequence in arguments.sequences
                if (arguments.out / sequence.name / "metrics.json").exists()]
    if finished:
        subprocess.run([tools / "metrics_table.py", *finished], check=True)
    return 0 if all(done) else 1


if __name__ == "__main__":
    run(main)
