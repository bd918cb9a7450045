#!/usr/bin/python3
"""Camera heights of known cameras: presets.py NAME KEY prints a value of config/presets.yaml, for the launch files."""

import pathlib
import sys

HERE = pathlib.Path(__file__).parent  # of a clone, or of an installation, where the file lies beside
FILE = next(file for file in (HERE / "presets.yaml", HERE.parent / "config/presets.yaml") if file.exists())


def preset(name):
    """Its camera_height and camera_height_sigma [m], source and pitfalls."""
    try:
        import yaml
    except ImportError:
        raise ValueError("a preset needs the Python module yaml") from None
    known = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    if name not in known:
        raise ValueError(f"there is no preset {name}, only {', '.join(known)}")
    return known[name]


if __name__ == "__main__":
    try:
        print(preset(sys.argv[1])[sys.argv[2]])
    except ValueError as error:
        sys.exit(str(error))
