"""Tables I and II and Fig. 5 of the paper of Tian et al., with its misprints corrected, beside our figures of whole
KITTI sequences, for scripts/report."""

import statistics

from benchmark import read_table
from environment import markdown, mean


# KITTI odometry sequences with ground truth, and their number of frames.
FRAMES = {"00": 4541, "01": 1101, "02": 4661, "03": 801, "04": 271, "05": 2761, "06": 1101, "07": 1101, "08": 4071,
          "09": 1591, "10": 1201}

# Length of the ground truth and of the paper's trajectory [m]. Its Table I has the two columns swapped, and
# relative errors of 02, 03 and 07 that do not follow from them.
LENGTHS = {"00": (3724.419, 3645.213), "02": (5067.233, 5071.151), "03": (560.888, 547.774),
           "04": (393.645, 391.861), "05": (2205.576, 2175.159), "06": (1232.876, 1235.982),
           "07": (694.697, 709.065), "08": (3222.795, 3137.398), "09": (1705.051, 1738.601), "10": (919.518, 911.399)}

# Table II: per system the mean errors over 100 to 800 m of the sequences 00 to 10.
PAPER, OURS = "Tian et al.", "ours"
TRANSLATION = {  # [%]
    "ORB-SLAM2-noLC": (20.8, None, 9.52, None, None, 18.63, 18.98, 13.82, 22.06, 12.74, 4.86),
    "VISO2-M": (11.91, None, 3.33, 10.66, 7.40, 12.67, 4.74, None, 13.94, 4.04, 25.20),
    "VISO2-Stereo": (2.32, None, 2.01, 2.32, 0.99, 1.78, 1.17, None, 2.35, 2.36, 1.37),
    "Song et al.": (2.04, None, 1.50, 3.37, 2.19, 1.43, 2.09, None, 2.37, 1.76, 2.12),
    "Zhou et al.": (2.17, None, None, 2.70, None, None, None, None, None, None, 2.09),
    "Wagstaff, Kelly": (1.86, None, 2.27, None, None, 1.50, 2.05, 1.78, 2.05, 1.50, 3.70),
    "DNet": (1.94, None, 3.07, None, None, 3.32, 2.74, 2.74, 2.72, 3.70, 5.09),
    PAPER: (1.41, None, 2.18, 1.79, 1.91, 1.61, 2.03, 1.77, 1.51, 1.77, 1.25),
}
ROTATION = {  # [deg/m]
    "VISO2-M": (0.0209, None, 0.0114, 0.0197, 0.0093, 0.0328, 0.0157, None, 0.0203, 0.0143, 0.0388),
    "VISO2-Stereo": (0.0109, None, 0.0074, 0.0107, 0.0081, 0.0098, 0.0072, None, 0.0104, 0.0094, 0.0086),
    "Song et al.": (0.0048, None, 0.0035, 0.0021, 0.0028, 0.0038, 0.0081, None, 0.0044, 0.0047, 0.0085),
    "Zhou et al.": (0.0039, None, None, 0.0044, None, None, None, None, None, None, 0.0054),
    PAPER: (0.0054, None, 0.0046, 0.0041, 0.0021, 0.0064, 0.0044, 0.0230, 0.0076, 0.0118, 0.0031),
}
# The paper's stages (its Fig. 5), and the direct measurement: columns of timing.csv.
STAGES = {"MVO": ["vo_total"], "GPE": ["scale_delaunay", "scale_gpe"], "GPA": ["scale_gpa"],
          "direct": ["scale_direct"], "total": ["total"]}
# The mean residual error of the lens in KITTI's rectified images: k1, k2, cx [px], cy [px].
KITTI_LENS_ERROR = "0.02,-0.007,1.5,1.5"
SOURCES = {
    "kitti": "Measured on the images of KITTI odometry.",
    "paths": "**Rendered**: the images show a street, rendered along the smoothed ground-truth path of each "
             "sequence, with a lens that differs from the published one as KITTI's does (render_drive --lens-error "
             f"{KITTI_LENS_ERROR}). Real images are more difficult; the figures of other systems are those on real images."}

EXPLANATION = (
    "The *published* lens is in calib.txt; the *estimated* one is the result of `scripts/calibrate_camera` on the sequence "
    "(NN.yaml), or the published one where the sequence does not determine the lens. A mean is the plain mean of a column's "
    "complete sequences. The paper's Table I has its two columns exchanged; its relative errors (RLE) are recomputed from them.")


def with_run_time(figures, folders):
    """Adds the median time of each stage over the frames in which it ran [ms]."""
    for folder in folders:
        table = read_table(folder / "timing.csv")
        for stage, columns in STAGES.items():
            times = sum(table[column] for column in columns)
            figures[folder.name][f"{stage}_ms"] = statistics.median(times[times > 0]) if any(times > 0) else None
    return figures


def table(figures, columns, form="{:.2f}"):
    """A row for each sequence and two for the means: of each column, and of the sequences for which both the paper
    and we have a figure. Incomplete sequences have no part in the means."""
    frames_of = {name: drive["frames"] for name, drive in figures["published"].items()}
    complete = [frames_of.get(name) == frames for name, frames in FRAMES.items()]
    rows = []
    for i, name in enumerate(FRAMES):
        partial = name in frames_of and not complete[i]
        rows.append([f"{name} ({frames_of[name]} of {FRAMES[name]} frames)" if partial else name,
                     *(values[i] for values in columns.values())])
    counted = {heading: [value if OURS not in heading or complete[i] else None for i, value in enumerate(values)]
               for heading, values in columns.items()}
    paper = [values for heading, values in columns.items() if heading.startswith(PAPER)][-1]
    both = [i for i in range(len(FRAMES)) if complete[i] and paper[i] is not None]
    rows += [["mean", *map(mean, counted.values())],
             [f"mean where {PAPER} and ours",
              *(None if None in (chosen := [values[i] for i in both]) else mean(chosen) for values in counted.values())]]
    return markdown(["sequence", *columns], [[row[0], *(None if value is None else form.format(value) for value in row[1:])]
                                             for row in rows])


def tables(figures):
    def own(key, lens):
        return [figures[lens].get(name, {}).get(key) for name in FRAMES]

    def ours(key, unit=""):
        return {f"{OURS}, {lens} lens{unit}": own(key, lens) for lens in figures}

    true_m, paper_m = zip(*(LENGTHS.get(name, (None, None)) for name in FRAMES))
    paper_rle = [None if true is None else 100 * abs(length - true) / true for true, length in zip(true_m, paper_m)]
    yield "Table I: length of the trajectory", table(figures, {
        "ground truth of the paper m": true_m, f"{PAPER} m": paper_m, "ground truth m": own("gt_length_m", "published"),
        **ours("length_m", " m"), f"{PAPER} RLE %": paper_rle, **ours("rle_percent", " RLE %")})
    yield "Table II: translation error, %", table(figures, {**TRANSLATION, **ours("t_err_percent")})
    yield "Table II: rotation error, deg/m", table(figures, {**ROTATION, **ours("r_err_deg_per_m")}, "{:.4f}")
    keys = [*(f"{stage}_ms" for stage in STAGES), "peak_rss_mb"]
    yield "Fig. 5: median time of each stage, and peak memory", markdown(
        ["sequence", *(key.replace("_", " ") for key in keys)],
        [[name, *(drive[key] for key in keys)] for name, drive in sorted(figures["estimated"].items())])


def write(part, figures, to):
    texts = ["# The paper's tables and figures", SOURCES[part],
             f"{EXPLANATION} Figs. 3 and 4: scale.png and trajectory.png of each sequence."]
    for heading, text in tables(figures):
        texts += [f"## {heading}", text]
    (to / "report.md").write_text("\n\n".join(texts) + "\n", encoding="utf-8")
