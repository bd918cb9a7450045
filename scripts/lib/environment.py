"""What the commands of scripts/ in Python share: arguments, set-up and build with environment.sh, tables."""

import argparse
import os
import pathlib
import signal
import socket
import subprocess
import sys

LIB = pathlib.Path(__file__).resolve().parent


class Parser(argparse.ArgumentParser):
    """The arguments of a command of scripts/. Wrong ones end it with one sentence."""

    def __init__(self, name, description):
        super().__init__(prog=f"scripts/{name}", description=description, allow_abbrev=False,
                         formatter_class=argparse.RawDescriptionHelpFormatter)

    def error(self, message, status=2):
        self.exit(status, f"{self.prog}: {message}\n")


def run(main):
    """Runs the command; its exit status is 130 when it is interrupted, 1 when a program that it calls fails."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
    except subprocess.CalledProcessError:
        sys.exit(1)  # the program has printed the reason


def build(*targets, packages=()):
    """Installs missing packages, builds what is out of date (without targets: everything), enters the environment of
    ROS and of this build, and returns the folder of the executables. Ends the command when that fails."""
    script = ('source "$1/environment.sh" && gsv_setup $2 >&2 && gsv_build "${@:3}" >&2 && gsv_env && '
              'GSV_TOOLS=$gsv_tools env -0')
    done = subprocess.run(["bash", "-c", script, "-", LIB, " ".join(packages), *targets], stdout=subprocess.PIPE,
                          check=False)
    if done.returncode:
        sys.exit(1)  # the script has printed the reason
    os.environ.update(entry.split("=", 1) for entry in done.stdout.decode().split("\0") if "=" in entry)
    return pathlib.Path(os.environ["GSV_TOOLS"])


def private_master():
    """The port of a ROS master that is separate from any running one, and the environment of its nodes."""
    with socket.socket() as free:
        free.bind(("", 0))
        port = str(free.getsockname()[1])
    environment = {key: value for key, value in os.environ.items() if key not in ("ROS_IP", "ROS_NAMESPACE")}
    return port, {**environment, "ROS_MASTER_URI": f"http://localhost:{port}", "ROS_HOSTNAME": "localhost",
                  "PYTHONUNBUFFERED": "1"}


def log(text):
    print(f"{pathlib.Path(sys.argv[0]).stem}: {text}", file=sys.stderr, flush=True)


def mean(values):
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def markdown(headings, rows):
    """A table; numbers with two decimals, None as a dash."""
    def cell(value):
        if value is None:
            return "–"
        return f"{value:.2f}" if isinstance(value, float) else str(value)

    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(f"| {' | '.join(map(cell, line))} |" for line in lines)
