#!/usr/bin/python3
"""Checks that every job of these GitHub workflows runs commands of scripts/ that exist."""

import os
import re
import sys

import yaml


def broken(file):
    with open(file, encoding="utf-8") as stream:
        jobs = yaml.safe_load(stream)["jobs"]
    for name, job in jobs.items():
        commands = re.findall(r"scripts/\w+", " ".join(step.get("run", "") for step in job["steps"]))
        missing = [command for command in commands if not os.access(command, os.X_OK)]
        if missing or not commands:
            yield f"{file}: {name} runs {', '.join(missing) or 'no command of scripts/'}"


def main():
    found = [line for file in sys.argv[1:] for line in broken(file)]
    print("\n".join(found))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
