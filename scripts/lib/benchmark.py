"""Measures time, processor time and memory over KITTI folders (see scripts/evaluate), and prints tables.

For each folder in turn: the offline pipeline with all its threads on one processor core, and in the same run the
baseline, OpenCV's pyramid, corner detection and Lucas-Kanade tracking of as many points on the same images; the same
on two cores, over the sequence again and again for 1500 frames (frames per second, memory over time); and both
nodelets under a private ROS master, with the sequence as a bag at its rate and 15 times as fast (latency from an
image to its metric odometry, dropped images). Measure on an idle machine.

Files in DIR/<name>/: benchmark.md (time of every stage, as Fig. 5 of the paper), benchmark.json, and the raw data:
one_core/, long_drive/ (see benchmark_sequence --help) and graph_RATE.csv (see graph_observer --help).

Exit status: 0 done, whatever the times are, 1 a measurement failed, 2 wrong arguments.
"""

import json
import os
import pathlib
import subprocess
import tempfile

from environment import Parser, build, log, markdown, private_master, run

# Columns of timing.csv; publish: of usage.csv; vo_rest: vo_total without the other stages of the odometry.
STAGES = {
    "decode": "decode", "vo_pyramid": "pyramid", "vo_track": "track", "vo_adjustment_wait": "wait for bundle adjustment",
    "vo_align": "align patches", "vo_pose": "pose", "vo_detect": "detect", "vo_triangulate": "triangulate",
    "vo_rest": "rest", "vo_total": "odometry, total", "vo_bundle_adjustment": "bundle adjustment (own thread)",
    "scale_delaunay": "Delaunay", "scale_gpe": "GPE", "scale_gpa": "GPA", "scale_direct": "direct plane estimation",
    "scale_filter": "filter", "scale_total": "scale stage, total", "publish": "publish", "total": "frame, total"}
RATES = 1, 15  # of the bag, relative to the recording
ODOMETRY_STAGES = ["vo_pyramid", "vo_track", "vo_adjustment_wait", "vo_align", "vo_pose", "vo_detect", "vo_triangulate"]
ROWS = [("processor time per frame on one core, ms", "cpu_ms_per_frame"),
        ("of which PNG decoding, ms", "decode_cpu_ms_per_frame"),
        ("ratio to OpenCV alone", "ratio_mean"),
        ("the same of the median frame, without bundle adjustment", "ratio_median"),
        ("ratio to OpenCV alone, corners only in keyframes", "ratio_same_detections"),
        ("frames/s offline, two cores, decoding included", "frames_per_second"),
        ("peak memory, MiB", "peak_rss_mb"), ("its growth in 1000 frames, MiB", "growth_mb_per_1000_frames")]


def read_table(file):
    """Columns by name."""
    import numpy as np
    table = np.atleast_1d(np.genfromtxt(file, delimiter=",", names=True))
    return {name: table[name] for name in table.dtype.names}


def read_run(folder):
    """Times and usage of one run of benchmark_sequence."""
    time, usage = read_table(folder / "timing.csv"), read_table(folder / "usage.csv")
    time["vo_rest"] = time["vo_total"] - sum(time[name] for name in ODOMETRY_STAGES)
    time["publish"] = usage["publish"]
    return time, usage


def offline_figures(folder):
    """The ratios are of processor time, which unlike wall time hardly depends on other load of the machine."""
    import numpy as np
    time, usage = read_run(folder / "one_core")
    baseline = read_table(folder / "one_core/baseline.csv")
    _, long_drive = read_run(folder / "long_drive")
    cpu, decode = 1e3 * usage["cpu_s"][-1] / len(usage["cpu_s"]), np.mean(usage["decode_cpu"])
    # The pipeline detects corners only in keyframes.
    detected = time["vo_detect"][1:] > 0
    same = baseline["cpu"] - np.where(detected, 0, baseline["detect"] / baseline["total"] * baseline["cpu"])
    rss = long_drive["rss_mb"]
    half = np.arange(len(rss) // 2, len(rss))
    stages = [(label, time[column]) for column, label in STAGES.items()]
    figures = {
        "cpu_ms_per_frame": cpu, "decode_cpu_ms_per_frame": decode,
        "ratio_mean": (cpu - decode) / np.mean(baseline["cpu"]),
        "ratio_median": np.median(usage["frame_cpu"][1:]) / np.median(baseline["cpu"]),
        "ratio_same_detections": (cpu - decode) / np.mean(same),
        "frames_per_second": len(rss) / long_drive["wall_s"][-1],
        "peak_rss_mb": long_drive["peak_rss_mb"][-1],
        "growth_mb_per_1000_frames": 1000 * np.polyfit(half, rss[half], 1)[0]}
    return {**{key: float(value) for key, value in figures.items()}, "long_drive_frames": len(rss),
            "stages": [[label, *(map(float, np.percentile(times[times > 0], [50, 95]) if np.any(times > 0) else (0, 0))),
                        float(np.mean(times > 0))] for label, times in stages]}


def graph_figures(file, rate, images):
    """Latency: wall time from the instant at which the player is due to publish an image, until another node
    receives its metric odometry. Due: linear in the stamp, with the offset of the image that arrived first."""
    import numpy as np
    table = read_table(file)
    frames = np.flatnonzero(np.isfinite(table["frame"]))
    due = table["stamp"] / rate
    latency = 1e3 * (table["odometry"] - due - np.nanmin(table["image"] - due))
    median, p99, largest = np.percentile(latency[np.isfinite(latency)], [50, 99, 100])
    known = frames[table["cpu_s"][frames] > 0]  # the process may be unknown in the first frames
    cpu = 1e3 * np.diff(table["cpu_s"][known[[0, -1]]])[0] / max(len(known) - 1, 1) if len(known) else np.nan
    return {"median_ms": float(median), "p99_ms": float(p99), "max_ms": float(largest), "dropped": images - len(frames),
            "cpu_ms_per_frame": float(cpu), "peak_rss_mb": float(np.max(table["peak_rss_mb"]))}


def play(tools, bag, rate, height, file):
    """Plays the bag through the nodelets; graph_observer writes a line for each image to the file."""
    port, environment = private_master()
    log_file = file.with_suffix(".log")
    with open(log_file, "w", encoding="utf-8") as output:
        options = {"env": environment, "stderr": output}
        master = subprocess.Popen(["roscore", "-p", port], stdout=output, **options)
        observer = subprocess.Popen([tools / "graph_observer", "--out", file,
                                     "image:=/kitti/camera_gray_left/image_rect"],
                                    stdout=subprocess.PIPE, text=True, **options)
        try:
            if not any(line.strip() == "listening" for line in observer.stdout):  # after messages of roscpp
                raise ValueError(f"graph_observer did not start, see {log_file}")
            subprocess.run(["roslaunch", "ground_scale_vo", "kitti.launch", "required:=true", f"bag:={bag}",
                            f"rate:={rate}", f"camera_height:={height}"], stdout=output, check=False, **options)
        finally:
            observer.send_signal(subprocess.signal.SIGINT)
            observer.communicate()
            master.terminate()
            master.wait()
    if "Playback finished: " not in log_file.read_text(encoding="utf-8", errors="replace"):
        raise ValueError(f"the run at rate {rate} failed, see {log_file}")


def tables(figures):
    """Markdown tables of drives by name."""
    names = list(figures)
    stages = [[label, *(value for name in names for value in figures[name]["stages"][i][1:3]),
               f"{100 * share:.0f} %"] for i, (label, _, _, share) in enumerate(figures[names[0]]["stages"])]
    yield markdown(["stage", *(f"{name} {what}" for name in names for what in ("median ms", "p95 ms")),
                    f"frames ({names[0]})"], stages)
    yield markdown(["", *names], [[label, *(figures[name].get(key) for name in names)] for label, key in ROWS])
    keys = ("median_ms", "p99_ms", "max_ms", "cpu_ms_per_frame", "dropped")
    yield markdown(["playback rate", *(f"{name} {key.replace('_', ' ')}" for name in names for key in keys)],
                   [[rate, *(figures[name]["rates"][f"{rate}"][key] for name in names for key in keys)] for rate in RATES])


def measure(tools, folder, out, arguments):
    def offline(to, cores, *options):
        subprocess.run(["rm", "-rf", out / to], check=True)
        subprocess.run([tools / "benchmark_sequence", folder, "--camera-height", arguments.camera_height, "--out", out / to,
                        *options], check=True,
                       preexec_fn=lambda: os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores]))

    out.mkdir(parents=True, exist_ok=True)
    log(f"{folder.name}: offline on one core, then OpenCV alone")
    offline("one_core", 1, "--baseline")
    frames = sum(1 for _ in open(out / "one_core/usage.csv", encoding="utf-8")) - 1
    log(f"{folder.name}: long drive on two cores")
    offline("long_drive", 2, "--repeat", str(-(-1500 // frames)))
    figures = {**offline_figures(out), "rates": {}}
    with tempfile.TemporaryDirectory() as work:
        bag = pathlib.Path(work) / "sequence.bag"
        subprocess.run([tools / "kitti_to_bag", folder, "--out", bag], check=True, stdout=subprocess.DEVNULL)
        for rate in RATES:
            log(f"{folder.name}: nodelets, bag at {rate} times its rate")
            file = out / f"graph_{rate}.csv"
            play(tools, bag, rate, arguments.camera_height, file)
            figures["rates"][f"{rate}"] = graph_figures(file, rate, frames)
    (out / "benchmark.json").write_text(json.dumps(figures, indent=1), encoding="utf-8")
    text = "\n\n".join([f"# {folder.name}: {frames} frames, load {os.getloadavg()[0]:.1f}", *tables({folder.name: figures})])
    (out / "benchmark.md").write_text(text + "\n", encoding="utf-8")
    print(text)


def main():
    parser = Parser("benchmark", __doc__)
    parser.add_argument("sequences", nargs="+", type=pathlib.Path, metavar="SEQ")
    parser.add_argument("--camera-height", default="1.65", metavar="M", help="above the road [m] (default 1.65)")
    parser.add_argument("--out", type=pathlib.Path, default="results/benchmark", metavar="DIR")
    arguments = parser.parse_args()
    for sequence in arguments.sequences:
        if not sequence.is_dir():
            parser.error(f"{sequence}: no such folder")
    tools = build()
    status = 0
    for sequence in map(pathlib.Path.resolve, arguments.sequences):
        try:
            measure(tools, sequence, arguments.out.resolve() / sequence.name, arguments)
        except (OSError, ValueError, KeyError, IndexError, subprocess.CalledProcessError) as error:
            log(f"{sequence.name}: {error}")
            status = 1
    return status


if __name__ == "__main__":
    run(main)
