"""Set-up and build for the commands of scripts/ in Python: environment.sh, called from Python."""

import os
import pathlib
import subprocess
import sys

LIB = pathlib.Path(__file__).resolve().parent


def build():
    """Builds what is out of date, enters the environment of ROS and of this build, and returns the folder of the
    executables. Ends the command when the build fails."""
    script = 'source "$1/environment.sh" && gsv_build >&2 && gsv_env && GSV_TOOLS=$gsv_tools env -0'
    done = subprocess.run(["bash", "-c", script, "-", LIB], stdout=subprocess.PIPE, check=False)
    if done.returncode:
        sys.exit(1)  # the script has printed the reason
    os.environ.update(entry.split("=", 1) for entry in done.stdout.decode().split("\0") if "=" in entry)
    return pathlib.Path(os.environ["GSV_TOOLS"])


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
