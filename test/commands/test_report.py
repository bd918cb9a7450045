"""scripts/report and derive_drives."""

import json
import re
import shutil

import benchmark_report
import matplotlib.image
import numpy
import pytest
import report_figures
import report_paper
import report_tables
from conftest import SCRIPTS, assert_refused, made_once, on_full_disk, run, table_rows, tool, write_program

REPORT = SCRIPTS / "report"
DERIVE, RENDER = tool("derive_drives"), tool("render_drive")
STEADY = ("--frames", 4, "--suspension", 0)


def test_measures_once(shortest, tmp_path):
    def report(*arguments):
        done = run(REPORT, shortest, "--only", "sequences", "--out", tmp_path, *arguments)
        return "measured before" in done.stderr

    assert not report()
    figures = json.loads((tmp_path / "sequences.json").read_text())
    metrics = json.loads((tmp_path / "sequences/shortest/metrics.json").read_text())
    assert figures["shortest"]["frames"] == 12
    assert figures["shortest"]["rle_percent"] == pytest.approx(metrics["rle_percent"], rel=1e-3)
    assert figures["run"]["command"] == "scripts/report shortest --only sequences"
    assert report()
    assert not report("--again", "sequences", "--camera-height", "1.6")
    metrics = json.loads((tmp_path / "sequences/shortest/metrics.json").read_text())
    assert metrics["camera_height_m"] == 1.6


@pytest.fixture
def stub_report(stub_tools, tmp_path):
    """stub_report(SEQ..., OPTION...): the output of scripts/report in a copy of scripts/ whose other commands, and
    the tools, only write their arguments to the file `calls`. Its results are in tmp_path/out."""
    tree = tmp_path / "tree"
    shutil.copytree(SCRIPTS, tree / "scripts")
    (tree / "CMakeLists.txt").touch()
    run("git", "init", "-q", tree)
    run("git", "-C", tree, "-c", "user.name=a", "-c", "user.email=a@b", "commit", "-q", "--allow-empty", "-m", "a")
    (tree / "scripts/report_figures.py").write_text(
        "import pathlib, sys\npathlib.Path(sys.argv[2], sys.argv[1] + '.json').write_text('{}')\n")
    for name in ("evaluate", "ablation", "benchmark", "calibrate_height"):
        write_program(tree / "scripts" / name, f'echo {name} "$*" >> {tmp_path}/calls')
    stubs = stub_tools("run_sequence", "evaluate_scenarios", "evaluate_faults", "derive_drives", "height_from_drive",
                       "render_drive", "benchmark_sequence", "kitti_to_bag", "graph_observer")
    tools = tmp_path / "stub_build/devel/lib/ground_scale_vo"
    write_program(tools / "derive_drives", f'echo derive_drives "$*" >> {tmp_path}/calls\n'
                                           'mkdir -p "$3/$(basename "$1")_half"')
    poses = "".join(f"1 0 0 0 0 1 0 0 0 0 1 {0.9 * i}\\n" for i in range(26))
    write_program(tools / "render_drive", f'mkdir -p "$1"\nprintf "{poses}" > "$1/poses.txt"')
    (tools.parent / "libground_scale_vo_core.so").touch()
    return lambda *arguments: run(tree / "scripts/report", *arguments, "--out", tmp_path / "out", **stubs).stderr


@pytest.mark.parametrize("part, files", [
    ("sequences", ["run_sequence", "../libground_scale_vo_core.so"]), ("variants", ["run_sequence", "derive_drives"]),
    ("scenarios", ["evaluate_scenarios"]), ("ablation", ["evaluate_scenarios"]),
    ("components", ["run_sequence", "scripts/ablation"]), ("faults", ["evaluate_faults"]),
    ("heights", ["height_from_drive", "render_drive"]),
    ("benchmark", ["benchmark_sequence", "kitti_to_bag", "graph_observer", "scripts/benchmark"]),
    ("growth", ["benchmark_sequence", "scripts/benchmark"]),
])
def test_measures_again_with_another_program(stub_report, tmp_path, part, files):
    sequence, tools = tmp_path / "kitti_00_0000_0199", tmp_path / "stub_build/devel/lib/ground_scale_vo"
    sequence.mkdir()
    write_poses(tmp_path / "out/sequences/kitti_00_0000_0199/ground_truth.txt", 26)

    def measured():
        return "measured before" not in stub_report(sequence, "--only", part)

    assert measured()
    (tools / "view_frame").write_text("a program that scripts/report does not run")
    assert not measured()
    for file in files:
        with open((tmp_path / "tree" if "scripts/" in file else tools) / file, "a", encoding="utf-8") as changed:
            changed.write("\n")
        assert measured(), file


def test_variants_are_derived_again(stub_report, tmp_path):
    """With the part, and only those of the given drives are evaluated."""
    out = tmp_path / "out"
    for name in ("kitti_00_0000_0199", "kitti_raw_0926_0039"):
        (tmp_path / name).mkdir()
    for name in ("kitti_00_0000_0199", "kitti_raw_0926_0039", "kitti_raw_0926_0039"):
        (tmp_path / "calls").unlink(missing_ok=True)
        stub_report(tmp_path / name, "--only", "variants", "--again", "variants")
        assert (tmp_path / "calls").read_text().splitlines() == [
            f"derive_drives {tmp_path}/{name} --out {out}/derived",
            f"evaluate --camera-height 1.65 --out {out}/variants {out}/derived/{name}_half/"]


def test_heights_of_drives(stub_report, tmp_path):
    """From the ground truth, and from its length."""
    (tmp_path / "a").mkdir()
    write_poses(tmp_path / "out/sequences/a/ground_truth.txt", 26)
    stub_report(tmp_path / "a", "--only", "heights", "--camera-height", 1.5)
    to, calls = tmp_path / "out/heights", (tmp_path / "calls").read_text().splitlines()
    assert len(calls) == 6 and (to / "a.truth").read_text() == "1.5\n" and (to / "low_2.truth").read_text() == "0.5\n"
    for name, drive, trajectory in (("a", tmp_path / "a", tmp_path / "out/sequences/a/ground_truth.txt"),
                                    ("low_1", to / "low_1", to / "low_1/poses.txt"),
                                    ("low_2", to / "low_2", to / "low_2/poses.txt")):
        assert calls.pop(0) == f"calibrate_height {drive} --trajectory {trajectory} --out {to}/{name}.trajectory.yaml"
        words = calls.pop(0).split()
        assert float(words.pop(3)) == pytest.approx(25 * 0.9)
        assert " ".join(words) == f"calibrate_height {drive} --length --length-sigma 0 --out {to}/{name}.length.yaml"


def test_failed_part(shortest, tmp_path):
    (tmp_path / "shortest").mkdir()
    done = run(REPORT, shortest, "--only", "sequences", "--camera-height", "0", "--out", tmp_path / "out",
               check=False)
    assert done.returncode == 1 and "sequences failed" in done.stderr
    assert not (tmp_path / "out/sequences.json").exists()


@pytest.mark.parametrize("text, arguments", [
    ("there is no part none", ["--only", "none"]),
    ("--none is not an option", ["--none"]),
    ("needs a value", ["--again"]),
])
def test_wrong_arguments(text, arguments):
    assert_refused(2, text, REPORT, *arguments)


@pytest.mark.long
def test_faults_are_collected(tmp_path):
    """From a file as evaluate_faults writes it."""
    (tmp_path / "faults").mkdir()
    text = run(tool("evaluate_faults"), "darker").stdout
    (tmp_path / "faults/faults.txt").write_text(text)
    run("/usr/bin/python3", SCRIPTS / "report_figures.py", "faults", tmp_path)
    faults = json.loads((tmp_path / "faults.json").read_text())
    assert faults["drives"] == 1 and faults["kinds"]["darker"]["count"] == 1
    assert 0 < faults["max_error_percent"] < 5 and faults["lines"] == text.splitlines()
    # In the order of the arguments, although the drive with the lorry is the longest.
    names = ["lorry", "darker", "flicker"]
    three = run(tool("evaluate_faults"), *names, "--threads", 3).stdout
    assert re.findall(r"^(\w+): \d+ frames", three, re.MULTILINE) == names
    other = run(tool("evaluate_faults"), "darker", "--seed", 1).stdout
    assert other.splitlines()[0] != text.splitlines()[0]  # another camera and speed


@pytest.mark.long
def test_scenarios_are_collected(tmp_path):
    """From files as evaluate_scenarios writes them."""
    (tmp_path / "ablation").mkdir()
    run(tool("evaluate_scenarios"), "camera_low", "--ablation", "--out", tmp_path / "ablation")
    run("/usr/bin/python3", SCRIPTS / "report_figures.py", "ablation", tmp_path)
    runs = json.loads((tmp_path / "ablation.json").read_text())["camera_low"]
    assert runs["default"]["violated"] == "" and 0 < runs["default"]["rle_percent"] < 1.5

    # The variants are those with the settings of their headings.
    def scenario(out, *settings):
        run(tool("evaluate_scenarios"), "camera_low", "--out", tmp_path / out, *settings)
        (scenario,) = json.loads((tmp_path / out / "scenarios.json").read_text())
        return {key: scenario[key] for key in ("rle_percent", "held", "within_2_sigma", "displacement_sigmas")}

    variants = {"default": [], "paper": ["--set", "paper_literal=true"], "features_only": ["--set", "refine=false"],
                "direct_only": ["--set", "gpe/min_points=1000000"]}
    figures = {name: scenario(name, *settings) for name, settings in variants.items()}
    assert {name: {key: runs[name][key] for key in figures[name]} for name in variants} == figures
    assert len({figure["rle_percent"] for figure in figures.values()}) == len(figures)

    # A setting of the command comes before those of the variants.
    run(tool("evaluate_scenarios"), "camera_low", "--ablation", "--set", "refine=false", "--out", tmp_path / "set")
    (other,) = json.loads((tmp_path / "set/ablation.json").read_text())
    assert {key: other["default"][key] for key in figures["default"]} == figures["features_only"]

    results = tmp_path / "default/camera_low"
    metrics = json.loads((results / "metrics.json").read_text())
    assert metrics["camera_height_m"] == 0.5 and metrics["height_bias_percent"] is not None
    poses = [numpy.loadtxt(results / name).reshape(-1, 3, 4) for name in ("ground_truth.txt", "poses.txt")]
    assert numpy.allclose(poses[0][0], numpy.eye(3, 4)) and poses[0].shape == poses[1].shape
    length = numpy.linalg.norm(poses[0][-1, :, 3])
    assert numpy.linalg.norm(poses[1][-1, :, 3] - poses[0][-1, :, 3]) < 0.05 * length


def write_poses(file, count, step=0.9):
    """Straight on, with so many metres between the positions."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("".join(f"1 0 0 0 0 1 0 0 0 0 1 {step * i}\n" for i in range(count)))


@pytest.fixture
def dataset(shortest, tmp_path):
    """dataset(NUMBER...): KITTI odometry with `shortest` as these sequences."""
    def make(*numbers):
        for number in numbers:
            folder = tmp_path / "dataset/sequences" / number
            folder.mkdir(parents=True)
            for name in ("image_0", "calib.txt", "times.txt"):
                (folder / name).symlink_to(shortest / name)
            (tmp_path / "dataset/poses").mkdir(exist_ok=True)
            (tmp_path / "dataset/poses" / f"{number}.txt").write_text((shortest / "poses.txt").read_text())
        return tmp_path / "dataset"
    return make


def test_whole_sequences(dataset, tmp_path):
    folder = dataset("02", "04")
    report = (REPORT, "--kitti", folder, "--out", tmp_path / "out")
    done = run(*report)
    assert "report: kitti 02" in done.stderr and "report: scenarios" not in done.stderr
    rows = table_rows(tmp_path / "out/kitti/report.md")
    metrics = json.loads((tmp_path / "out/kitti/02/metrics.json").read_text())
    lengths, translation, rotation = rows["02 (12 of 4661 frames)"]
    assert lengths == ["5067.2", "5071.2", f"{metrics['gt_length_m']:.1f}", f"{metrics['length_m']:.1f}", "0.08",
                       f"{metrics['rle_percent']:.2f}"]
    assert translation[-2:] == ["2.18", "–"] and rotation[-2:] == ["0.0046", "–"]
    assert rows["mean"][1][-2:] == ["1.72", "–"]  # of the paper; ours is not complete
    for name in ("fig3.png", "fig4.png", "fig5.png"):
        assert matplotlib.image.imread(tmp_path / "out/kitti" / name).std() > 0
    assert json.loads((tmp_path / "out/kitti.json").read_text())["run"]["command"] == "scripts/report --kitti dataset"
    assert "kitti: measured before" in run(*report).stderr

    # One more sequence: the others are not measured again. Those that are not there any more are dropped.
    dataset("05")
    for file in (folder / "sequences/04").iterdir():
        file.unlink()
    (folder / "sequences/04").rmdir()
    log = run(*report).stderr
    assert "kitti 02: measured before" in log and "kitti 05" in log and "kitti 04" not in log
    assert {"02 (12 of 4661 frames)", "04", "05 (12 of 2761 frames)"} <= set(
        table_rows(tmp_path / "out/kitti/report.md"))


def test_sequences_that_cannot_be_used(dataset, tmp_path):
    folder = dataset("02", "04", "05")
    (folder / "poses/02.txt").unlink()
    write_poses(folder / "poses/05.txt", 5)
    done = run(REPORT, "--kitti", folder, "--out", tmp_path / "out", check=False)
    assert done.returncode == 1
    assert f"{folder}/poses/02.txt: no such file" in done.stderr
    assert f"{folder}/poses/05.txt: has 5 ground truth poses for 12 images" in done.stderr
    rows = table_rows(tmp_path / "out/kitti/report.md")
    assert {"02", "04 (12 of 271 frames)", "05"} <= set(rows)
    assert not (tmp_path / "out/kitti.json").exists()


def test_rendered_paths(tmp_path):
    write_poses(tmp_path / "poses/04.txt", 26)
    write_poses(tmp_path / "poses/07.txt", 11, step=1)
    (tmp_path / "poses/10.txt").write_text("1 0 0 0 0 1 0 0 0 0 1\n")
    report = (REPORT, "--paths", tmp_path / "poses", "--out", tmp_path / "out")
    done = run(*report, check=False)
    assert done.returncode == 1
    assert f"{tmp_path}/poses/07.txt: has a path of 10 m" in done.stderr
    assert f"{tmp_path}/poses/10.txt, line 1: " in done.stderr
    assert not (tmp_path / "out/paths/images").exists()
    text = (tmp_path / "out/paths/report.md").read_text()
    assert "**Rendered**" in text
    lengths, *_ = table_rows(tmp_path / "out/paths/report.md")["04 (26 of 271 frames)"]
    assert float(lengths[2]) == pytest.approx(22.5, abs=0.3) and float(lengths[5]) < 5

    (tmp_path / "poses/07.txt").unlink()
    (tmp_path / "poses/10.txt").unlink()
    assert "paths 04: measured before" in run(*report).stderr
    assert json.loads((tmp_path / "out/paths.json").read_text())["04"]["frames"] == 26


@pytest.mark.parametrize("option, made, text", [
    ("--kitti", "", "--kitti: "), ("--paths", "", "--paths: "),
    ("--kitti", "sequences", "sequences: there is none of 00 to 10"),
    ("--paths", "poses", "there is none of 00.txt to 10.txt"),
])
def test_nothing_to_compare(tmp_path, option, made, text):
    if made:
        (tmp_path / "data" / made).mkdir(parents=True)
    assert_refused(1, text, REPORT, option, tmp_path / "data", "--out", tmp_path / "out")


def test_paper_tables_with_complete_sequences():
    figures = {name: {**report_figures.drive_figures(drive_metrics(frames=frames, t_err_percent=error)),
                      "length_m": 1.0, "peak_rss_mb": 90.0, "run_time_ms": {"MVO": 5.0}}
               for name, frames, error in (("00", 4541, 0.5), ("01", 1101, 3.0), ("02", 4661, 1.0), ("03", 9, 9.0))}
    rows = report_tables.paper_tables({"run": {}, **figures})["translation_errors"].splitlines()
    means, both = ([cell.strip() for cell in row.strip("|").split("|")][-2:] for row in rows[-2:])
    assert means == ["1.72", "1.50"]      # of ten sequences, of 00 to 02
    assert both == [f"{(1.41 + 2.18) / 2:.2f}", "0.75"]  # of 00 and 02


@pytest.mark.parametrize("arguments, text", [
    (["--path", "{poses}", "--frames", 31], "frames (at most one for each position of the path) is 31"),
    (["--path", "{poses}", "--scenario", "night"], "--path and --scenario cannot be combined"),
    (["--path", "{poses}.none"], "poses.txt.none"),
])
def test_paths_that_cannot_be_rendered(tmp_path, arguments, text):
    write_poses(tmp_path / "poses.txt", 30)
    words = [str(word).format(poses=tmp_path / "poses.txt") for word in arguments]
    done = run(RENDER, tmp_path / "drive", *words, check=False)
    assert done.returncode in (1, 2) and text in done.stderr, done.stderr
    assert not (tmp_path / "drive").exists()


def test_consistency_intervals():
    drive = {"gt_length_m": 105.0, "nees_10": 1.38, "within_10": 0.90}
    for length in (50, 100):
        drive.update({f"nees_{length}": 1.40, f"within_{length}": None})
    # Quantiles of chi^2 with 60, 12 and 6 degrees of freedom, divided by these.
    for length, low, high in ((10, 0.675, 1.388), (50, 0.367, 1.945), (100, 0.206, 2.408)):
        assert report_tables.nees_interval(drive, length) == pytest.approx([low, high], abs=0.01)
    # 60 draws of 0.9545.
    assert report_tables.share_interval(drive, 10) == pytest.approx([0.9018, 1], abs=1e-3)
    cells = report_tables.consistency_table({"run": {}, "it": drive}).splitlines()[2].split("|")[1:-1]
    assert [cell.strip().startswith("**") for cell in cells] == [False, False, False, False, True, False, False]


def drive_metrics(**changes):
    """Of metrics.json; each value differs from the others."""
    lengths = [{"length_m": length, "nees_per_dof": 1 + 0.001 * length, "within_2_sigma": 0.9 + 0.0001 * length,
                "nees_per_dof_exact_ground_truth": 2 + 0.001 * length} for length in (10, 50)]
    values = {key: 0.25 + i for i, key in enumerate(report_figures.METRICS)}
    return {"frames": 200, "tracked_frames": 199, "lost_events": 1, **values, "covariance_by_length": lengths,
            **changes}


@pytest.fixture
def collected(tmp_path):
    """collected(PART): what report_figures.py collects from the folder of that part."""
    def collect(part):
        run("/usr/bin/python3", SCRIPTS / "report_figures.py", part, tmp_path, "--version=abc")
        return json.loads((tmp_path / f"{part}.json").read_text())
    return collect


def test_figures_of_sequences(collected, tmp_path):
    for name, metrics in (("kitti_00_0000_0199", drive_metrics()), ("kitti_00_0000_0199_dark", drive_metrics()),
                          ("other-1", drive_metrics(rle_percent=1.23456789, covariance_by_length=None))):
        (tmp_path / "sequences" / name).mkdir(parents=True)
        (tmp_path / "sequences" / name / "metrics.json").write_text(json.dumps(metrics))
    figures = collected("sequences")
    assert set(figures) == {"run", "00", "00_dark", "other_1"} and figures["run"]["version"] == "abc"
    expected = {key: value for key, value in drive_metrics().items() if key != "covariance_by_length"}
    assert figures["00"] == {**expected, "nees_10": 1.01, "nees_50": 1.05, "nees_100": None, "nees_exact_10": 2.01,
                             "nees_exact_50": 2.05, "nees_exact_100": None, "within_10": 0.901, "within_50": 0.905,
                             "within_100": None}
    assert figures["other_1"]["rle_percent"] == 1.2346 and figures["other_1"]["nees_10"] is None


def test_run_time_of_the_stages_of_the_paper(tmp_path):
    """The median over the frames in which a stage runs."""
    folder = tmp_path / "07"
    folder.mkdir()
    (folder / "metrics.json").write_text(json.dumps(drive_metrics(length_m=1, peak_rss_mb=1)))
    columns = ("vo_total", "scale_delaunay", "scale_gpe", "scale_gpa", "scale_direct", "scale_filter", "total")
    (folder / "timing.csv").write_text(",".join(columns) + "\n1,2,4,8,16,32,64\n3,0,0,0,0,0,64\n5,2,6,8,18,32,70\n")
    assert report_figures.kitti(tmp_path)["07"]["run_time_ms"] == {
        "MVO": 3, "GPE": 7, "GPA": 8, "direct": 17, "total": 64}


def test_heights_of_the_paper(tmp_path):
    """The scale is proportional to the inverse of the height in units of the odometry: of two frames with the same
    filtered scale, that with the larger scale of its own is lower."""
    (tmp_path / "metrics.json").write_text('{"camera_height_m": 1.65}')
    (tmp_path / "scale.csv").write_text(
        "status,raw_scale,scale,map_id\nunknown,2,1,0\nok,1.25,1.5,0\nheld,0,1.5,0\nok,2,1.5,0\nok,3,6,1\n")
    frames, raw, filtered = report_paper.heights(tmp_path)
    assert frames.tolist() == [1, 3, 4]
    assert raw == pytest.approx([1.98, 1.2375, 3.3]) and filtered == pytest.approx([1.65] * 3)


def test_trajectory_with_one_scale():
    """That of the first 50 m, although the scale of the odometry drifts after them."""
    forward = numpy.arange(101.0)
    metric = numpy.stack([0 * forward, 0 * forward, forward], axis=1)
    unscaled = metric * numpy.where(forward <= 50, 0.5, 0.25)[:, None]
    scaled = report_paper.with_one_scale(unscaled, metric)
    assert scaled[:51] == pytest.approx(metric[:51]) and scaled[51:] == pytest.approx(metric[51:] / 2)


def test_figures_of_faults_are_the_largest(collected, tmp_path):
    """Never is more than any number of frames or seconds. The lines are those of evaluate_faults."""
    (tmp_path / "faults").mkdir()
    line = ("  frames  40 to  80: {}          4.0 s, hides: detected {} s, ok {}, tracking {}, metric {}, "
            "excess path {} m, error {} m, sigma {} m\n")
    (tmp_path / "faults/faults.txt").write_text(
        "  frames  10 to  39:  30.0 m, error 1.25 %\n" +
        line.format("black", "0.1", 0, 2, 5, "0.50", "3.0", "9.0") +
        line.format("black", "0.3", 1, 1, 4, "0.25", "7.0", "2.0") +
        line.format("covered left", "nan", 0, -1, 5, "0.50", "3.0", "9.0") +
        line.format("covered left", "0.1", 0, 2, -1, "0.50", "3.0", "9.0") +
        "4 drives, 1 with a violated threshold\n")
    figures = collected("faults")
    assert (figures["drives"], figures["violated"], figures["max_error_percent"]) == (4, 1, 1.25)
    assert figures["lines"][-1] == "4 drives, 1 with a violated threshold" and len(figures["lines"]) == 6
    assert figures["kinds"] == {
        "black": {"count": 2, "detected_s": 0.3, "ok_frames": 1, "tracking_frames": 2, "metric_frames": 5,
                  "excess_path_m": 0.5, "error_m": 7.0, "sigma_m": 9.0},
        "covered_left": {"count": 2, "detected_s": None, "ok_frames": 0, "tracking_frames": None,
                         "metric_frames": None, "excess_path_m": 0.5, "error_m": 3.0, "sigma_m": 9.0}}
    rows = report_tables.fault_table(figures).splitlines()[2:]
    assert rows == ["| black | 2 | 0.3 | 5 | 0.50 | 7.0 | 9.0 |",
                    "| covered left | 2 | never | never | 0.50 | 3.0 | 9.0 |"]


def test_components_of_other_drives():
    figures = {"t_err_percent": 1, "rle_percent": 2, "scale_within_2_sigma": 0.5, "height_bias_percent": None}
    rows = [{"label": "default", "drives": {"mine": figures, "00": figures}}]
    assert report_tables.component_table({"rows": rows}).splitlines()[0] == "|  | 00 | mine |"


def test_figures_of_ablation_and_heights(collected, tmp_path):
    for part in ("ablation", "heights"):
        (tmp_path / part).mkdir()
    run_of = {"rle_percent": 1.5, "held": 0.25, "within_2_sigma": 0.75, "displacement_sigmas": 2.5,
              "violated": "RLE", "clearly": False}
    (tmp_path / "ablation/ablation.json").write_text(json.dumps(
        [{"drive": "night", "component": "c", "default": {**run_of, "frames": 7}}]))
    assert collected("ablation")["night"] == {"component": "c", "default": run_of}
    (tmp_path / "heights/low_1.truth").write_text("0.5\n")
    (tmp_path / "heights/low_1.length.yaml").write_text(
        "# x\ncamera_height: 0.5125  # [m] ± 0.0075 (95 %), 1.5 %\n")
    assert collected("heights")["low_1"] == {"true_m": 0.5, "length": [0.5125, 0.0075], "trajectory": None}


def test_figures_of_benchmark(collected, tmp_path):
    stage = {"median": 1.5, "p95": 2.5, "p99": 3.5, "max": 4.5, "share": 0.75, "mean": 1.25}
    latency = dict(zip(("median", "p95", "p99", "max"), (10.5, 11.5, 12.5, 13.5)))
    report = {
        "one_core": {"stages_ms": {column: stage for _, column, _ in benchmark_report.STAGES},
                     "cpu_ms_per_frame": 20.5, "decode_cpu_ms_per_frame": 5.5},
        "two_cores": {"frames_per_second": 70.5},
        "pipeline_over_baseline": {"median": 1.75, "mean_with_adjustment": 2.25,
                                   "mean_with_adjustment_and_its_detections": 3.25},
        "memory": {"peak_rss_mb": 150.5, "frames": 1500},
        "graph": [{"rate": 3.0, "latency_ms": latency, "latency_to_frame_ms": {key: 0.5 for key in latency},
                   "dropped": 2, "cpu_ms_per_frame": 25.5, "peak_rss_mb": 160.5}]}
    (tmp_path / "benchmark/kitti_00_0000_0199").mkdir(parents=True)
    (tmp_path / "benchmark/kitti_00_0000_0199/benchmark.json").write_text(json.dumps(report))
    figures = collected("benchmark")["00"]
    assert figures.pop("stages") == [[label, 1.5, 2.5, 0.75] for _, _, label in benchmark_report.STAGES]
    assert figures == {
        "cpu_ms_per_frame": 20.5, "decode_cpu_ms_per_frame": 5.5, "ratio_mean": 2.25, "ratio_median": 1.75,
        "ratio_same_detections": 3.25, "frames_per_second": 70.5, "peak_rss_mb": 150.5, "long_drive_frames": 1500,
        "rates": {"3": {"median_ms": 10.5, "p99_ms": 12.5, "max_ms": 13.5, "dropped": 2, "cpu_ms_per_frame": 25.5,
                        "peak_rss_mb": 160.5}}}


def test_part_without_results_is_refused(tmp_path):
    (tmp_path / "sequences").mkdir()
    assert_refused(1, "no results", "/usr/bin/python3", SCRIPTS / "report_figures.py", "sequences", tmp_path)


def test_tables():
    assert report_tables.interval([1.0, 2.0, 3.0, None]) == "2.00 ± 0.58"
    drive = report_figures.drive_figures(drive_metrics())
    row = report_tables.sequence_table({"run": {}, "00": drive}).splitlines()[-1]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    number = {key: drive[key] for key in report_figures.METRICS}
    assert cells[1:] == ["200 (1)", f"{number['gt_length_m']:.0f}", f"{number['rle_percent']:.2f}",
                         f"{number['t_err_percent']:.2f}", f"{number['r_err_deg_per_m']:.4f}",
                         f"{number['scale_within_2_sigma']:.2f}"]
    stages = {"00": {"stages": [["track", 2.0, 3.0, 0.5], ["adjustment", 0.5, 0.75, 0.125]]}}
    assert report_tables.stage_table(stages).splitlines()[2:] == [
        "| track | 2.0 | 3.0 | 50 % |", "| adjustment | 0.50 | 0.75 | 12 % |"]


def test_summary():
    part = {str(i): {**report_figures.drive_figures(drive_metrics()), "first_scale_error_sigmas": sigmas,
                     "first_metric_pose_m": first, "rle_percent": rle}
            for i, (sigmas, first, rle) in enumerate([(-3.0, 2.0, 1.0), (-1.0, 4.0, 2.0), (0.0, 0.0, None),
                                                    (None, None, 6.0)])}
    summary = report_tables.summary({"sequences": {"run": {}, **part}})
    assert (summary["drives"], summary["pose_within_3_m"], summary["scale_within_2_sigma"]) == (4, 2, 2)
    figures = summary["sequences"]
    assert {end: figures[f"rle_percent{end}"] for end in ("", "_drives", "_min", "_max", "_median")} == {
        "": 3.0, "_drives": 3, "_min": 1.0, "_max": 6.0, "_median": 2.0}
    assert figures["t_err_percent_drives"] == 4


@pytest.fixture(scope="module")
def level(data):
    return made_once(data / "level", lambda: run(RENDER, *STEADY, "--pitch", 0, data / "level"))


def images(folder):
    return [matplotlib.image.imread(file) for file in sorted((folder / "image_0").iterdir())]


@pytest.mark.parametrize("variant, mounting", [
    ("roll5", ("--pitch", 0, "--roll", numpy.radians(-5))),
    ("pitch6", ("--pitch", numpy.radians(6))),
    ("yaw8", ("--pitch", 0, "--yaw", numpy.radians(8))),
])
def test_turned_as_rendered(level, tmp_path, variant, mounting):
    """Turned images agree with those of a camera that is mounted so; so do the ground truths."""
    run(DERIVE, level, variant, "--out", tmp_path)
    run(RENDER, *STEADY, *mounting, tmp_path / "rendered")
    derived, rendered = tmp_path / f"level_{variant}", tmp_path / "rendered"
    for table in ("poses.txt", "ground.txt", "times.txt"):
        assert numpy.allclose(numpy.loadtxt(derived / table), numpy.loadtxt(rendered / table), atol=1e-6)
    calib = [numpy.array((folder / "calib.txt").read_text().split()[1:], float)
             for folder in (derived, rendered)]
    left, top = (calib[1] - calib[0])[[2, 6]].round().astype(int)
    for image, whole in zip(images(derived), images(rendered)):
        height, width = image.shape
        assert width * height > 0.5 * whole.size
        part = whole[top:top + height, left:left + width]
        assert numpy.corrcoef(image.ravel(), part.ravel())[0, 1] > 0.95


def test_derived_frames_and_sizes(level, tmp_path):
    run(DERIVE, level, "reverse", "every2", "half", "crop640", "jpeg20", "dark", "--out", tmp_path)
    level_images, level_poses = images(level), numpy.loadtxt(level / "poses.txt").reshape(-1, 3, 4)
    reverse = numpy.loadtxt(tmp_path / "level_reverse/poses.txt").reshape(-1, 3, 4)
    forwards = level_poses[3][:, :3].T @ (level_poses[0][:, 3] - level_poses[3][:, 3])
    assert numpy.allclose(reverse[3][:, 3], forwards) and reverse[3][2, 3] < 0
    assert numpy.array_equal(images(tmp_path / "level_reverse")[0], level_images[3])
    assert numpy.all(numpy.diff(numpy.loadtxt(tmp_path / "level_reverse/times.txt")) > 0)
    every2 = images(tmp_path / "level_every2")
    assert len(every2) == 2 and numpy.array_equal(every2[1], level_images[2])
    assert [images(tmp_path / f"level_{name}")[0].shape for name in ("half", "crop640")] == \
        [(124, 400), (248, 640)]
    dark = images(tmp_path / "level_dark")[0]
    assert dark.mean() == pytest.approx(0.25 * level_images[0].mean(), rel=0.1)
    assert sorted((tmp_path / "level_jpeg20/image_0").iterdir())[0].suffix == ".jpg"
    for name in ("half", "crop640"):
        run(tool("run_sequence"), tmp_path / f"level_{name}", "--camera-height", 1.65, "--out", tmp_path / "o")


def test_derive_refusals(level, tmp_path):
    assert_refused(2, "unknown variant 'none', there are reverse, every2", DERIVE, level, "none",
                   "--out", tmp_path)
    assert_refused(1, "cannot be written", DERIVE, level, "half", "--out", tmp_path, **on_full_disk(10))
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "level_half").mkdir()
    assert_refused(1, "level_half already exists", DERIVE, level, "half", "--out", tmp_path)
