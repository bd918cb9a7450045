"""The tables of scripts/report: DIR/results.md, docs/results.md with the first two of them, and the table of README.md."""

import math

from environment import markdown, mean

LENGTHS = (10, 50, 100)  # of the segments for the covariance [m]
DRIVE_COLUMNS = [("frames", "frames"), ("tracked", "tracked_frames"), ("length m", "gt_length_m"), ("RLE %", "rle_percent"),
                 ("t_err %", "t_err_percent"), ("t_err short %", "t_err_short_percent"),
                 ("t_err true length %", "t_err_true_length_percent"), ("r_err deg/m", "r_err_deg_per_m"),
                 ("2σ", "scale_within_2_sigma"), ("held", "scale_held_share"), ("first pose m", "first_metric_pose_m"),
                 ("NEES 50 m", "nees_50")]
README_COLUMNS = [("frames", "frames"), ("length m", "gt_length_m"), ("RLE %", "rle_percent"),
                  ("t_err %", "t_err_percent"), ("first metric pose m", "first_metric_pose_m")]
README_DRIVES = ("00", "0039", "rendered_09")
MARKS = "<!-- results -->", "<!-- /results -->"


def drives(part):
    """The drives of a part; of several seeds the first one."""
    if "seeds" in part:
        return next(iter(part["seeds"].values()))
    return {name: drive for name, drive in part.items() if name != "run"}


def with_error(values):
    """Mean and its standard error over drives."""
    known = [value for value in values if value is not None]
    if len(known) < 2:
        return mean(known)
    centre = mean(known)
    deviation = math.sqrt(sum((value - centre) ** 2 for value in known) / (len(known) - 1) / len(known))
    return f"{centre:.2f} ± {deviation:.2f}"


def cell(drive, key):
    value = drive.get(key)
    if value is None or key in ("frames", "tracked_frames"):
        return value
    return f"{value:.4f}" if key == "r_err_deg_per_m" else float(value)  # JSON has 0 for 0.0


def drive_table(part, columns, descriptions):
    return markdown(["drive", *(heading for heading, _ in columns)],
                    [[descriptions.get(name, name), *(cell(drive, key) for _, key in columns)]
                     for name, drive in sorted(drives(part).items())])


def summary_table(results):
    sets = {part: drives(results[part]).values() for part in ("sequences", "variants", "scenarios") if part in results}
    keys = [("RLE %", "rle_percent"), ("t_err %", "t_err_percent"), ("t_err short %", "t_err_short_percent"),
            ("2σ", "scale_within_2_sigma"), ("first pose m", "first_metric_pose_m"),
            *((f"NEES {length} m", f"nees_{length}") for length in LENGTHS),
            *((f"within 2σ, {length} m", f"within_{length}") for length in LENGTHS)]
    return markdown(["mean ± standard error", "drives", *(heading for heading, _ in keys)],
                    [[part, len(members), *(with_error([drive[key] for drive in members]) for _, key in keys)]
                     for part, members in sets.items()])


def component_table(part):
    rows = part["rows"]
    names = sorted(rows[0]["drives"])
    keys = ("t_err_percent", "rle_percent", "scale_within_2_sigma")

    def text(drive):
        return " / ".join("–" if drive[key] is None else f"{drive[key]:.2f}" for key in keys)

    return markdown(["t_err % / RLE % / 2σ", *names],
                    [[row["label"], *(text(row["drives"][name]) for name in names)] for row in rows])


def sections(results, descriptions):
    """Heading, remark, and table."""
    if any(part in results for part in ("sequences", "variants", "scenarios")):
        yield "Summary", "", summary_table(results)
    remark = "2σ: share of frames whose true scale lies within two standard deviations. NEES per degree of freedom: 1 is " \
             "consistent, more is overconfident."
    for part in ("sequences", "variants", "scenarios"):
        if part in results:
            yield part.capitalize(), remark if part == "sequences" else "", drive_table(
                results[part], DRIVE_COLUMNS, descriptions)
    if "components" in results:
        yield "Components over the sequences", "", component_table(results["components"])


def page(results, descriptions, chosen=None):
    """chosen: the headings of the sections; None: all."""
    texts = ["# Results", "Written by `scripts/report`, with further tables in its folder `DIR`; do not edit. [Commands and "
             "files](reference/commands.md#output-files) defines the figures."]
    for heading, remark, table in sections(results, descriptions):
        if chosen and heading not in chosen:
            continue
        texts += [f"## {heading}", *([remark] if remark else []), table]
    runs = [[part, results[part]["run"]["version"], results[part]["run"]["date"], results[part]["run"]["load"]]
            for part in results]
    return "\n\n".join([*texts, "## Runs", markdown(["part", "version", "date", "load of the machine"], runs)]) + "\n"


def write(results, descriptions, root):
    (root / "docs/results.md").write_text(page(results, descriptions, ("Summary", "Sequences")), encoding="utf-8")
    readme = root / "README.md"
    before, _, rest = readme.read_text(encoding="utf-8").partition(MARKS[0])
    _, _, after = rest.partition(MARKS[1])
    run = results["sequences"]["run"]
    chosen = {name: drive for name, drive in drives(results["sequences"]).items() if name in README_DRIVES}
    table = drive_table(chosen, README_COLUMNS, descriptions)
    readme.write_text(f"{before}{MARKS[0]}\n{table}\n\nVersion {run['version']}, {run['date']}.\n{MARKS[1]}{after}",
                      encoding="utf-8")
