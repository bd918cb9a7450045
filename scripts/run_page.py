#!/usr/bin/python3
"""Writes report.html, one file without network, into result folders: whether a trajectory can be trusted, and where
not."""

import argparse
import base64
import io
import json
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile
from typing import NamedTuple

import jinja2
import numpy as np
from markupsafe import Markup
from PIL import Image

try:
    from . import plot_run  # of the Python package
except ImportError:  # this is a program
    sys.path.insert(0, str(pathlib.Path(__file__).parent))  # the one of a devel space has another first folder
    import plot_run

matplotlib, plt = plot_run.matplotlib, plot_run.plt

MAX_PLACES = 5
MAX_POINTS = 2000  # of a curve
WIDTH = 5  # of a figure [inches]
# Each stands for a colour of the style sheet, which has another one at night.
COLOURS = {name: f"#0{number}0{number}0{number}" for number, name in enumerate(
    ("ink", "muted", "line", "estimate", "truth", "measured", "held", "lost", "paper"), 1)}
REASONS = {
    "vo_not_tracking": "nothing to track: texture, exposure, or too much motion between images",
    "too_few_triangles": "few features on the road: hood in view, glare, or a road too dark or too smooth",
    "too_few_ground_points": "few points ahead lie on the road: traffic or kerb",
    "no_plane": "what is ahead is not one plane: kerb, car or verge",
    "plane_tilted": "the plane ahead is tilted: kerb, slope beside the road, or a rolled camera",
    "rejected_by_filter": "the measured height differs from the filtered one: another surface, or load and mounting",
    "implausible_motion": "the pose implies a speed above 100 m/s"}


class Verdict(NamedTuple):
    level: int  # 0: usable, 1: in part or with warnings, 2: not usable
    title: str
    reasons: list


class Run:
    """The files of a result folder."""

    def __init__(self, folder):
        self.name = folder.resolve().name
        self.metrics = json.loads((folder / "metrics.json").read_text())
        said = folder / "run.json"  # Record.write() of Python writes none
        self.said = json.loads(said.read_text()) if said.exists() else {}
        self.failure, self.warnings = self.said.get("failure", ""), self.said.get("warnings", [])
        self.first_image = self.said.get("first_image", 0)  # number in the drive
        self.scale = plot_run.read_table(folder / "scale.csv")
        self.positions = plot_run.read_positions(folder / "poses.txt")
        truth = folder / "ground_truth.txt"
        self.truth = plot_run.read_positions(truth) if truth.exists() else None
        self.time = self.scale["stamp"] - self.scale["stamp"][0]
        self.steps = np.linalg.norm(np.diff(self.positions, axis=0, append=self.positions[-1:]), axis=1)
        self.distance = np.cumsum(self.steps) - self.steps
        self.length = self.distance[-1]
        status = self.scale["status"]
        known = (status != "unknown") & (self.scale["vo_status"] == "tracking")
        self.first = int(np.argmax(known)) if known.any() else len(known)
        self.state = np.where(known, np.where(status == "ok", "measured", "held"), "lost")
        self.state[known & (self.scale["reason"] == "standstill")] = "measured"
        self.state[:self.first] = "unknown"
        self.known = np.isin(self.state, ("measured", "held"))
        # Standard deviation of the scale, and what was measured minus the scale in use, both of the latter [%].
        percent = np.where(self.known, 100 / np.where(self.known, self.scale["scale"], 1), np.nan)
        self.sigma = percent * self.scale["sigma"]
        raw = self.scale["raw_scale"]
        self.deviation = np.where(raw > 0, percent * raw - 100, np.nan)

    def runs(self, state):
        """The first frame of each run of frames in this state, and the one after its last."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], self.state == state, [False]]).astype(int)))
        return edges.reshape(-1, 2)

    def share(self, state):
        """Of the distance."""
        return self.steps[self.state == state].sum() / self.length if self.length > 0 else 0.0

    def length_error(self):
        """Relative to the ground truth; 0 without one."""
        true_length = self.metrics["gt_length_m"]
        return self.metrics["length_m"] / true_length - 1 if true_length else 0.0

    def metres(self, start, end):
        return self.steps[start:end].sum()

    def seconds(self, start, end):
        return self.time[min(end, len(self.time) - 1)] - self.time[start]


def verdict(run):
    metrics, found = run.metrics, []
    has_no_pose = run.first == len(run.time)
    if run.failure or has_no_pose:
        is_little = has_no_pose or 2 * metrics["tracked_frames"] < metrics["frames"]
        found.append((1 + is_little, run.failure or "no metric pose"))
    gaps = run.runs("lost")
    if len(gaps):
        places = ", ".join(f"{run.distance[start]:.0f} m" for start, _ in gaps[:3]) + (" …" if len(gaps) > 3 else "")
        found.append((1, f"position lost {len(gaps)}× (at {places}), {100 * run.share('lost'):.0f} % of the distance is "
                      "bridged"))
    if run.share("held") > 0.2:
        found.append((1, f"scale not measured over {100 * run.share('held'):.0f} % of the distance"))
    interval = 1.96 * (metrics["length_sigma_m"] or 0) / max(run.length, 1)
    if interval > 0.05 and not has_no_pose:
        found.append((1, f"length known only to ± {100 * interval:.0f} %"))
    error = 0 if has_no_pose else run.length_error()
    if abs(error) > max(interval, 0.02):
        found.append((1 + (abs(error) > 0.1), f"length differs by {100 * error:+.1f} % from the ground truth"))
    if run.warnings:
        found.append((1, f"{len(run.warnings)} warning{'s' * (len(run.warnings) > 1)}, see below"))
    level = max((one for one, _ in found), default=0)
    title = ("Usable", "Usable in part", "Not usable")[level]
    if level == 1 and len(found) == 1 and run.warnings:
        title = "Usable, with warnings"
    return Verdict(level, title, [text for _, text in found] or [
        f"tracked in {metrics['tracked_frames']} of {metrics['frames']} images, scale measured over "
        f"{100 * run.share('measured'):.0f} % of the distance, length known to ± {100 * interval:.1f} %"])


def worst_places(run):
    """(frame, reason) of at most MAX_PLACES, apart from each other: where the position is lost, the scale is not known or
    held longest, least certain, and farthest from a measurement."""
    def why(start, end):
        reasons = [reason for reason in run.scale["reason"][start:end] if reason in REASONS]
        return f": {REASONS[max(set(reasons), key=reasons.count)]}" if reasons else ""

    def longest(state, least):
        found = [(run.metres(*one), *one) for one in run.runs(state)]
        return sorted((one for one in found if one[0] >= least), reverse=True)

    places = [(start, f"Position lost for {run.seconds(start, end):.1f} s; {metres:.1f} m are bridged with the velocities "
               "before and after") for metres, start, end in longest("lost", 0)]
    places += [((start + end) // 2, f"No metric pose for {run.seconds(start, end):.1f} s{why(start, end)}")
               for metres, start, end in longest("unknown", 0) if metres > 5 or run.seconds(start, end) > 3]
    places += [((start + end) // 2, f"Scale held for {metres:.1f} m{why(start, end)}")
               for metres, start, end in longest("held", 2)]
    if run.known.any():
        sigma, jump = np.nan_to_num(run.sigma), np.nan_to_num(run.deviation)
        least, farthest = np.argmax(sigma), np.argmax(np.abs(jump))
        places += [(least, f"Least certain scale: ± {1.96 * sigma[least]:.1f} % (95 %)"),
                   (farthest, f"Measured scale {jump[farthest]:+.1f} % from the filtered one")]
    apart = []
    for frame, reason in places:
        if len(apart) < MAX_PLACES and all(abs(frame - other) > len(run.time) / 20 for other, _ in apart):
            apart.append((int(frame), reason))
    return sorted(apart)


def thinned(*columns):
    return [column[::1 + len(column) // MAX_POINTS] for column in columns]


def svg(figure):
    """For the inside of a page: with the colours and the font of its style sheet."""
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "page"}):
        figure.savefig(stream, format="svg", transparent=True)
    plt.close(figure)
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", stream.getvalue(), flags=re.DOTALL)
    box = re.search(r'viewBox="[^"]*"', text)[0]
    text = f'<svg {box} role="img">' + text[text.index(">", text.index("<svg")) + 1:]
    text = re.sub(r"'?DejaVu Sans'?(,[^;\"]*)?", "system-ui, sans-serif", text)
    for name, colour in COLOURS.items():
        text = text.replace(colour, f"var(--{name})")
    return Markup(text)


def axes_of(height, top=0.1, bottom=0.4, **labels):
    """Of the width of a column of the page; with these margins [inches]."""
    with matplotlib.rc_context({
            "font.size": 9, "text.color": COLOURS["ink"], "axes.edgecolor": COLOURS["line"], "axes.spines.top": False,
            "axes.spines.right": False, "axes.labelcolor": COLOURS["muted"], "xtick.color": COLOURS["muted"],
            "ytick.color": COLOURS["muted"], "axes.grid": True, "grid.color": COLOURS["line"], "grid.linewidth": 0.6,
            "axes.axisbelow": True}):
        axes = plt.figure(figsize=(WIDTH, height)).add_axes(
            [0.7 / WIDTH, bottom / height, 1 - 0.8 / WIDTH, 1 - (top + bottom) / height])
    axes.set(**labels)
    return axes


def badge(axes, number, x, y, **arguments):
    axes.text(x, y, str(number), color=COLOURS["ink"], fontsize=7, ha="center", va="center", zorder=9, bbox={
        "boxstyle": "circle,pad=0.25", "facecolor": COLOURS["paper"], "edgecolor": COLOURS["ink"], "linewidth": 0.8},
        **arguments)


def draw_path(run, places):
    x, z = run.positions[:, 0], run.positions[:, 2]
    every = np.concatenate([run.positions] + ([] if run.truth is None else [run.truth]))[:, [0, 2]]
    low, high = every.min(axis=0), every.max(axis=0)
    span = 1.12 * np.maximum(high - low, 1)
    width = max(span[0], span[1] * 0.9)  # at most this high
    span = np.array([width, max(span[1], 0.35 * width)])
    axes = axes_of(0.5 + (WIDTH - 0.8) * span[1] / span[0], xlabel="x, right [m]", ylabel="z, forward [m]")
    axes.set(xlim=(low + high)[0] / 2 + span[0] / 2 * np.array([-1, 1]),
             ylim=(low + high)[1] / 2 + span[1] / 2 * np.array([-1, 1]))
    if run.truth is not None:
        axes.plot(*thinned(run.truth[:, 0], run.truth[:, 2]), "--", color=COLOURS["truth"], linewidth=1.2)
    axes.plot(*thinned(x, z), color=COLOURS["estimate"], linewidth=2)
    for state in ("held", "lost"):
        drawn = np.where(run.state == state, 0, np.nan)
        drawn[1:] = np.fmin(drawn[1:], drawn[:-1])  # to the next frame
        axes.plot(x + drawn, z + drawn, color=COLOURS[state], linewidth=3, solid_capstyle="butt")
    axes.plot(x[0], z[0], "o", color=COLOURS["ink"], markersize=5)
    for number, (frame, _) in enumerate(places, 1):
        badge(axes, number, x[frame], z[frame])
    return svg(axes.figure)


def draw_map(shapes):
    axes = axes_of(4)
    plot_run.draw_map(axes, shapes, COLOURS["estimate"], COLOURS["measured"], COLOURS["lost"])
    return svg(axes.figure)


def draw_speed(run):
    """Over half a second, between frames with a position."""
    axes = axes_of(1.6, bottom=0.25, ylabel="speed [m/s]")
    frames = np.flatnonzero(run.state != "lost")
    step = max(1, round(0.5 / max(np.median(np.diff(run.time)), 1e-3)))
    start, end = frames[:-step], frames[step:]
    for positions, style, colour in ((run.truth, "--", "truth"), (run.positions, "-", "estimate")):
        if positions is not None:
            speed = np.linalg.norm(positions[end] - positions[start], axis=1) / (run.time[end] - run.time[start])
            axes.plot(*thinned(run.distance[start], speed), style, color=COLOURS[colour], linewidth=1.4)
    axes.set(xlim=(0, run.length), ylim=(0, None))
    return svg(axes.figure)


def draw_scale(run, places):
    axes = axes_of(2.2, top=0.4, xlabel="distance [m]", ylabel="deviation [%]")
    axes.fill_between(*thinned(run.distance, -2 * run.sigma, 2 * run.sigma), color=COLOURS["estimate"], alpha=0.25,
                      linewidth=0)
    axes.plot(*thinned(run.distance, run.deviation), ".", color=COLOURS["estimate"], markersize=2.5)
    limit = 1.3 * np.nanpercentile(np.abs(np.concatenate([run.deviation, 2 * run.sigma])), 97)
    axes.set(xlim=(0, run.length), ylim=(-limit, limit))
    for state in ("measured", "held", "lost"):
        least = run.length / 300 if state == "lost" else 0  # it can be seen
        bars = [(run.distance[start], max(least, run.metres(start, end))) for start, end in run.runs(state)]
        axes.broken_barh(bars, (1.02, 0.06), color=COLOURS[state], linewidth=0, clip_on=False,
                         transform=axes.get_xaxis_transform())
    for number, (frame, _) in enumerate(places, 1):
        badge(axes, number, run.distance[frame], 1.18, transform=axes.get_xaxis_transform())
    return svg(axes.figure)


def picture(image):
    """A thumbnail as the address of a picture in the page."""
    if image is None:
        return None
    thumbnail, stream = Image.fromarray(image), io.BytesIO()
    thumbnail.thumbnail((640, 480))
    thumbnail.save(stream, "JPEG", quality=80)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode()


def write(folder, command="", images_at=lambda frames: [None] * len(frames)):
    """Writes report.html. command: a list of words. images_at: returns the grey image of each of the ascending frames, or
    None. Returns the verdict."""
    run = Run(folder)
    decision, places = verdict(run), worst_places(run)
    has_path, shapes = run.length > 0, plot_run.read_map(folder)
    pictures = [picture(image) for image in images_at([run.first_image + frame for frame, _ in places])]
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(pathlib.Path(__file__).parent), autoescape=True,
                                     trim_blocks=True, lstrip_blocks=True)
    text = environment.get_template("run_page.html").render(
        run=run, verdict=decision, command=shlex.join(command) if command else "",
        path=draw_path(run, places) if has_path else "", map=draw_map(shapes) if shapes else "", speed=draw_speed(run) if has_path else "",
        scale=draw_scale(run, places) if has_path else "",
        places=[{"frame": frame, "reason": reason, "time": run.time[frame], "stamp": run.scale["stamp"][frame],
                 "distance": run.distance[frame], "picture": one}
                for (frame, reason), one in zip(places, pictures)])
    temporary = folder / "report.html.tmp"
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(folder / "report.html")
    finally:
        temporary.unlink(missing_ok=True)
    return decision


def images_of(command):
    """images_at for write(), of a command that writes those of --images N... to --out DIR, as DIR/N.png."""
    def images_at(frames):
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([*command, "--out", folder, "--images", *map(str, frames)], check=False)
            files = [pathlib.Path(folder) / f"{frame}.png" for frame in frames]
            return [np.asarray(Image.open(file)) if file.exists() else None for file in files]
    return images_at


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=pathlib.Path, metavar="DIR", help="a result folder")
    parser.add_argument("--command", type=shlex.split, default="", help="the command that made the results, for the page")
    parser.add_argument("--images", type=shlex.split, default="", metavar="COMMAND",
                        help="run_sequence or evaluate_bag with the drive and its options, for images of the worst places")
    arguments = parser.parse_args()
    try:
        write(arguments.folder, arguments.command, *[images_of(arguments.images)] * bool(arguments.images))
    except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
        sys.exit(f"run_page.py: {arguments.folder}: has no page ({error})")


if __name__ == "__main__":
    main()
