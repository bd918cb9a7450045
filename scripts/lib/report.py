"""Measures the accuracy, the robustness and the cost of this version, and writes tables.

Less than an hour on two cores for the six sequences of the docs; measure on an idle machine. A part that has been
measured with this build and these arguments is skipped, so an interrupted run can be continued.

Parts:
  gate        these four:
  sequences   SEQ...
  variants    13 more difficult variants (derive_drives) of each of SEQ... with at least 150 frames, except rendered_04
  scenarios   the rendered scenarios
  faults      rendered drives with a fault each
  ablation    the scenarios in several configurations
  components  SEQ... with one component changed at a time
  benchmark   time and memory on kitti_raw_0926_0039 and kitti_00_0000_0199
  kitti       whole KITTI sequences (--kitti) with the published and with the estimated lens, beside the tables and
              figures of the paper, in DIR/kitti/report.md
  paths       the same on streets rendered along KITTI's paths (--paths), in DIR/paths/report.md; five minutes for 1000 frames
The gate is measured with each of --seeds: of the draws of the core, and of the noise of the rendered cameras; results.md
has the first seed. scripts/compare reads two files DIR/results.json and judges a change by the gate and, where both
versions have it, by benchmark (--only gate --only benchmark).

Files: DIR/results.json, DIR/results.md (drives, components), and the results of each part in DIR/PART/, with a table of
their own: table.md of scenarios, faults and ablation, benchmark.md of benchmark, report.md of kitti and paths.
Exit status: 0 all done, 1 a part failed (the others are still measured), 2 wrong arguments.
"""

import concurrent.futures
import datetime
import hashlib
import json
import os
import pathlib
import shutil
import subprocess
import sys

import paper
from environment import LIB, Parser, build, log, run

ROOT = LIB.parents[1]
DRIVES = {  # folder: its name and its description in the docs
    "kitti_00_0000_0199": ("00", "KITTI odometry 00, frames 0–199"),
    "kitti_05_0100_0159": ("05", "KITTI odometry 05, frames 100–159"),
    "kitti_06_0000_0050": ("06", "KITTI odometry 06, frames 0–50"),
    "kitti_07_0000_0129": ("07", "KITTI odometry 07, frames 0–129"),
    "kitti_raw_0926_0039": ("0039", "KITTI raw 2011_09_26 drive 0039"),
    "rendered_04": ("rendered_04", "rendered street, path of KITTI 04"),
    "rendered_09_traffic": ("rendered_09", "rendered street with traffic and a stop")}
DESCRIPTIONS = dict(DRIVES.values())
LENGTHS = (10, 50, 100)  # of the segments for the covariance [m]
METRICS = ("frames", "tracked_frames", "lost_events", "gt_length_m", "length_m", "rle_percent", "t_err_percent",
           "r_err_deg_per_m", "t_err_short_percent", "t_err_true_length_percent", "t_err_sim3_percent",
           "scale_within_2_sigma", "scale_held_share", "first_metric_pose_m", "first_scale_error_sigmas",
           "height_bias_percent", "peak_rss_mb")
PAPER = "config/paper.yaml"
COMPONENTS = {  # label: options, or a file with them
    "**defaults**": "",
    "paper as printed": PAPER,
    "calibration as exact (no refinement)": "refine_camera=false",
    "features only (no direct measurement)": "refine=false",
    "direct only": "gpe/min_points=1000000",
    "no road curvature (direct)": "direct/curvature_sigma=1e-9",
    "no error of the relative poses (direct)": "direct/rotation_sigma_rad=1e-9 direct/direction_sigma_rad=1e-9",
    "half the baselines (direct)": "direct/baseline_heights=0.35",
    "twice the baselines (direct)": "direct/baseline_heights=1.4",
    "patches of 0.022 focal lengths (direct)": "direct/patch_size=0.022",
    "minimum correlation of 0.5 (direct)": "direct/min_correlation=0.5",
    "lane region three times as wide (direct)": "direct/lane_half_width_heights=3",
    "no road roughness (direct)": "direct/roughness_heights=1e-6",
    "window of one frame": "gpa/max_frames=1",
    "wide region from the start (features)": "gpe/lane_half_width_heights=4",
    "pitch without the direction of motion": "mounting/pitch_motion_sigma=1 mounting/heave_sigma_heights=1",
    "direction of motion from one frame": "mounting/chord_length_heights=0.01",
    "RANSAC threshold without the depth error": "gpe/plane_threshold_sigma=0",
    "no camber (features)": "fit/camber_sigma_rad=1e-9",
    "no height of its own for the ground beside the lane": "filter/kerb_sigma=0",
    "no NIS scaling of sigma": "filter/nis_memory_heights=1000000",
    "independent measurements in the filter": "filter/correlation_heights=0",
    "no drift with rotation": "filter/drift_per_k1_sigma=0",
    "no tilt of a young map": "filter/start_tilt_sigma_rad=0",
    "no patch alignment with the first keyframe": "alignment/min_correlation=1",
    "corners on edges": "tracker/min_corner_ratio=0",
}


def read(file):
    return json.loads(file.read_text(encoding="utf-8"))


def short_name(folder):
    """The name in the docs of a drive or of its variant."""
    known = [name for name in DRIVES if folder == name or folder.startswith(name + "_")]
    return DRIVES[known[0]][0] + folder[len(known[0]):] if known else folder


class Report:
    """The parts: PART() measures into the folder `to`, and returns the figures."""

    def __init__(self, arguments):
        self.arguments, self.out, self.tools = arguments, arguments.out.resolve(), None
        self.folders = [folder.resolve() for folder in arguments.sequences]

    def chosen(self, part):
        """Folders or files that a part needs; None: it needs none."""
        if part in ("scenarios", "faults", "ablation"):
            return None
        if part == "variants":
            return [f for f in self.folders if len(os.listdir(f / "image_0")) >= 150 and f.name != "rendered_04"]
        if part == "benchmark":
            return [f for f in self.folders if short_name(f.name) in ("00", "0039")]
        if part == "kitti":
            return sorted((self.arguments.kitti / "sequences").resolve().glob("[01][0-9]")) if self.arguments.kitti else []
        if part == "paths":
            return sorted(self.arguments.paths.resolve().glob("[01][0-9].txt")) if self.arguments.paths else []
        return self.folders

    def tool(self, name, *arguments, **options):
        """Runs an executable or a command of scripts/; its output appears only when it fails."""
        program = LIB.parent / name if (LIB.parent / name).exists() else self.tools / name
        done = subprocess.run([program, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                              check=False, **options)
        if done.returncode:
            print(done.stderr, file=sys.stderr)
            done.check_returncode()
        return done.stdout

    def run(self, folders, to, settings="", options=()):
        """Runs the odometry over KITTI folders; returns the metrics of each by its short name."""
        def one(folder):
            sets = ["--options", ROOT / settings] if settings == PAPER else [
                word for setting in settings.split() for word in ("--set", setting)]
            self.tool("run_sequence", folder, "--camera-height", self.arguments.camera_height, "--out", to, *options, *sets)

        with concurrent.futures.ThreadPoolExecutor(self.arguments.threads) as pool:
            list(pool.map(one, folders))
        return self.metrics(to / folder.name for folder in folders)

    @staticmethod
    def metrics(folders):
        figures = {}
        for folder in folders:
            metrics = read(folder / "metrics.json")
            figures[short_name(folder.name)] = drive = {key: metrics[key] for key in METRICS}
            lengths = {entry["length_m"]: entry for entry in metrics["covariance_by_length"] or []}
            for length in LENGTHS:
                entry = lengths.get(length, {})
                drive[f"nees_{length}"], drive[f"within_{length}"] = entry.get("nees_per_dof"), entry.get("within_2_sigma")
        return figures

    def for_each_seed(self, to, measure):
        """measure: of a seed and a folder, the metrics of each drive."""
        return {"seeds": {seed: measure(seed, to / f"seed_{seed}") for seed in self.arguments.seeds}}

    def sequences(self, folders, to):
        return self.for_each_seed(to, lambda seed, folder: self.run(folders, folder, f"random_seed={seed}"))

    def variants(self, folders, to):
        for folder in folders:
            self.tool("derive_drives", folder, "--out", to / "drives")
        figures = self.sequences(sorted((to / "drives").iterdir()), to)
        shutil.rmtree(to / "drives")
        return figures

    def evaluate_scenarios(self, to, *arguments):
        table = self.tool("evaluate_scenarios", *arguments, "--out", to, "--threads", self.arguments.threads)
        (to / "table.md").write_text(table, encoding="utf-8")
        return {entry.pop("drive"): entry for entry in read(to / "scenarios.json")}

    def scenarios(self, _, to):
        def measure(seed, folder):
            runs = self.evaluate_scenarios(folder, "--seed", seed)
            drives = self.metrics(folder / name for name in runs)
            return {name: {**drive, "violated": runs[name]["default"]["violated"]} for name, drive in drives.items()}
        return self.for_each_seed(to, measure)

    def faults(self, _, to):
        return self.for_each_seed(to, lambda seed, folder: {
            name: entry["default"]
            for name, entry in self.evaluate_scenarios(folder, "faults", "--seed", seed).items()})

    def ablation(self, _, to):
        return self.evaluate_scenarios(to, "--ablation", "--paper", ROOT / PAPER)

    def components(self, folders, to):
        return {"rows": [{"label": label, "drives": self.run(folders, to / str(row), settings)}
                         for row, (label, settings) in enumerate(COMPONENTS.items())]}

    def benchmark(self, folders, to):
        self.tool("benchmark", *folders, "--camera-height", self.arguments.camera_height, "--out", to)
        return {short_name(folder.name): read(to / folder.name / "benchmark.json") for folder in folders}

    def whole_sequences(self, part, inputs, to, folder_of):
        """Resumable: a sequence that has been measured with the same key is kept."""
        lenses = ("published", "estimated")
        for source in inputs:
            key = to / f"{source.stem}.key"
            wanted = f"{self.hash()} {source} {self.arguments.camera_height}"
            if not key.exists() or key.read_text() != wanted:
                log(f"{part} {source.stem}")
                shutil.rmtree(to / "images", ignore_errors=True)
                folder, camera = folder_of(source), to / f"{source.stem}.yaml"
                camera.unlink(missing_ok=True)
                try:
                    self.tool("calibrate_camera", folder, "--out", camera)
                except subprocess.CalledProcessError as error:
                    if error.returncode != 1:  # 1: the sequence does not determine the lens
                        raise
                    log(f"{part} {source.stem}: keeps the published lens")
                for lens in lenses:
                    estimated = lens == "estimated" and camera.exists()
                    self.run([folder], to / lens, options=["--camera", camera] if estimated else [])
                    self.tool("plot_run.py", to / lens / source.stem)
                shutil.rmtree(to / "images", ignore_errors=True)
                key.write_text(wanted)
        figures = {}
        for lens in lenses:
            results = [to / lens / source.stem for source in inputs]
            figures[lens] = paper.with_run_time(self.metrics(results), results)
        paper.write(part, figures, to)
        return figures

    def kitti(self, inputs, to):
        return self.whole_sequences("kitti", inputs, to, lambda folder: folder)

    def paths(self, inputs, to):
        def render(file):
            folder = to / "images" / file.stem
            self.tool("render_drive", folder, "--path", file, "--size", "1241x376", "--camera-height",
                      self.arguments.camera_height, "--lens-error", paper.KITTI_LENS_ERROR)
            return folder
        return self.whole_sequences("paths", inputs, to, render)

    def hash(self):
        """A digest of the programs whose figures are measured."""
        digest = hashlib.sha256()
        for file in [*sorted(self.tools.glob("*_*")), *sorted(self.tools.parent.glob("libground_scale_vo*.so"))]:
            if file.is_file():
                digest.update(file.read_bytes())
        return digest.hexdigest()[:16]

    def measure(self, part):
        """False when the part failed."""
        chosen, file = self.chosen(part), self.out / f"{part}.json"
        seeds = ",".join(self.arguments.seeds) if part in GATE else ""
        key = f"{self.hash()} {self.arguments.camera_height} {seeds} {' '.join(map(str, chosen or []))}"
        if chosen == []:
            return True
        if file.exists() and read(file)["run"]["key"] == key:
            log(f"{part}: measured before")
            return True
        log(part)
        file.unlink(missing_ok=True)
        to = self.out / part
        if part not in ("kitti", "paths"):
            shutil.rmtree(to, ignore_errors=True)
        to.mkdir(parents=True, exist_ok=True)
        try:
            figures = getattr(self, part)(chosen, to)
        except (OSError, ValueError, KeyError, subprocess.CalledProcessError) as error:
            log(f"{part} failed: {error}")
            return False
        describe = ["git", "-C", ROOT, "describe", "--always", "--dirty"]
        version = subprocess.run(describe, stdout=subprocess.PIPE, text=True, check=False).stdout.strip()
        figures["run"] = {"key": key, "version": version, "date": datetime.date.today().isoformat(),
                          "load": os.getloadavg()[0]}
        file.write_text(json.dumps(figures, indent=1), encoding="utf-8")
        return True


GATE = ["sequences", "variants", "scenarios", "faults"]
PARTS = [*GATE, "ablation", "components", "benchmark", "kitti", "paths"]


def seeds(text):
    if not all(0 < int(seed) <= 1000000 for seed in text.split(",")):
        raise ValueError
    return text.split(",")


def main():
    parser = Parser("report", __doc__)
    parser.add_argument("sequences", nargs="*", type=pathlib.Path, metavar="SEQ",
                        help="KITTI folders with ground truth, see scripts/evaluate")
    parser.add_argument("--kitti", type=pathlib.Path, metavar="DATASET",
                        help="folder of KITTI odometry, with sequences/00 to 10 and poses/")
    parser.add_argument("--paths", type=pathlib.Path, metavar="POSES", help="folder with KITTI's 00.txt to 10.txt")
    parser.add_argument("--camera-height", default="1.65", metavar="M", help="above the road [m] (default 1.65)")
    parser.add_argument("--out", type=pathlib.Path, default="results/report", metavar="DIR")
    parser.add_argument("--only", action="append", choices=["gate", *PARTS], metavar="PART", help="only this part; repeatable")
    parser.add_argument("--seeds", type=seeds, default="1,2,3", metavar="N,...", help="of the gate's parts (default 1,2,3)")
    parser.add_argument("--threads", type=int, default=2, help="drives at once (default 2), except in benchmark")
    parser.add_argument("--write", action="store_true",
                        help="write docs/results.md (summary, sequences) and the table of README.md from DIR/results.json")
    arguments = parser.parse_args()
    for folder in [*arguments.sequences, arguments.kitti, arguments.paths]:
        if folder and not folder.is_dir():
            parser.error(f"{folder}: no such folder")
    if not (ROOT / "package.xml").exists():
        parser.error("needs the source tree", status=1)
    report = Report(arguments)
    report.tools = build()
    whole = [part for part in ("kitti", "paths") if getattr(arguments, part)]
    parts = arguments.only or (whole if whole and not arguments.sequences else PARTS)
    parts = [*parts, *(GATE if "gate" in parts else [])]
    failed = [part for part in PARTS if part in parts and not report.measure(part)]

    import results_page
    results = {part: read(file) for part in PARTS for file in [report.out / f"{part}.json"] if file.exists()}
    (report.out / "results.json").write_text(json.dumps(results, indent=1), encoding="utf-8")
    (report.out / "results.md").write_text(results_page.page(results, DESCRIPTIONS), encoding="utf-8")
    if arguments.write:
        results_page.write(results, DESCRIPTIONS, ROOT)
    return 1 if failed else 0


if __name__ == "__main__":
    run(main)
