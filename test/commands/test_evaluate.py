"""scripts/evaluate, scripts/ablation and the offline run behind them."""

import json
import re

import matplotlib.image
import numpy
import pytest
from conftest import SCRIPTS, assert_refused, on_full_disk, on_terminal, run, tool

EVALUATE = SCRIPTS / "evaluate"
RUN_SEQUENCE = tool("run_sequence")


def test_progress_on_a_terminal(shortest, tmp_path):
    output = on_terminal(RUN_SEQUENCE, shortest, "--camera-height", 1.65, "--out", tmp_path)
    assert "\rshortest: 12/12 frames, " in output
    distance = max(float(metres) for metres in re.findall(r"12/12 frames, [\d.]+/s, ([\d.]+) m", output))
    driven = numpy.linalg.norm(numpy.loadtxt(shortest / "poses.txt")[-1, 3::4])
    assert 0.5 * driven < distance < 1.2 * driven
    metrics = json.loads((tmp_path / "shortest/metrics.json").read_text())
    assert f"12 tracked, {metrics['length_m']:.1f} m, written to" in output


def test_set_reaches_the_run(short, tmp_path):
    done = run(EVALUATE, short, "--out", tmp_path, "--set", "refine=false", "--set",
               "gpe/min_points=1000000")
    assert "no frame got a scale" in done.stdout + done.stderr


def test_set_reaches_the_scenarios(tmp_path):
    run(tool("evaluate_scenarios"), "night_noisy", "--out", tmp_path, "--set", "refine=false", "--set",
        "gpe/min_points=1000000")
    (drive,) = json.loads((tmp_path / "scenarios.json").read_text())
    assert (drive["drive"], drive["tracked_frames"], drive["metric_frames"]) == ("night_noisy", 30, 0)


@pytest.mark.parametrize("text, arguments", [
    ("there is no option foo", ["SHORT", "--set", "foo=1"]),
    ("gpe/min_points", ["SHORT", "SHORTEST", "--set", "gpe/min_points=abc"]),
    ("--camera-height", ["SHORT", "--camera-height", "0"]),
    ("camera_height is 1000", ["SHORT", "--camera-height", "1000"]),
    ("--scenarios", ["SHORT", "--ablation"]),
    ("unknown scenario", ["--scenarios", "none"]),
    ("--faults", ["SHORT", "--seed", "1"]),
    ("--mask", ["--scenarios", "--mask", "mask.png"]),
    ("--faults", ["--faults", "--set", "refine=false"]),
    ("--out cannot be used with --faults", ["--faults"]),
    ("exclude one another", ["--scenarios", "--covariance"]),
    ("exclude one another", ["--scenarios", "--faults"]),
    ("exclude one another", ["--covariance", "--faults"]),
    ("--camera-height cannot be used with --scenarios", ["--scenarios", "--camera-height", "1.65"]),
    ("tracker/cell_size is 7", ["--scenarios", "pitched", "--set", "tracker/cell_size=7"]),
])
def test_wrong_arguments(short, shortest, tmp_path, text, arguments):
    sequences = {"SHORT": short, "SHORTEST": shortest}
    arguments = [sequences.get(word, word) for word in arguments]
    assert_refused(2, text, EVALUATE, *arguments, "--out", tmp_path)


def test_wrong_arguments_of_faults():
    assert_refused(2, "unknown fault", EVALUATE, "--faults", "none")
    assert_refused(2, "--camera-height cannot be used with --scenarios or --faults", EVALUATE, "--faults",
                   "--camera-height", 1.65)


@pytest.mark.parametrize("command", ["evaluate", "benchmark", "ablation"])
def test_no_such_folder(command):
    assert_refused(1, "none: no such folder", SCRIPTS / command, "none")


def test_mask(short, tmp_path):
    """One that hides everything: no corner is found."""
    mask = tmp_path / "mask.png"

    def write(value, width=800):
        matplotlib.image.imsave(mask, numpy.full((248, width), value), cmap="gray", vmin=0, vmax=1)

    for value, found in ((0, False), (1, True)):
        write(value)
        done = run(EVALUATE, short, "--out", tmp_path, "--mask", mask)
        assert ("no frame got a scale" not in done.stdout + done.stderr) == found
    write(1, width=799)
    assert_refused(1, f"--mask {mask} is 799x248, the camera 800x248", EVALUATE, short, "--out",
                   tmp_path, "--mask", mask)
    assert_refused(1, "none.png", EVALUATE, short, "--out", tmp_path, "--mask", "none.png")


def test_misspelt_option(short, tmp_path):
    assert_refused(2, "did you mean tracker/cell_size?", RUN_SEQUENCE, short, "--camera-height",
                   1.65, "--out", tmp_path, "--set", "tracker/cel_size=1")


def test_refuses_to_overwrite_the_sequence(short):
    assert_refused(1, "over the sequence", RUN_SEQUENCE, short, "--camera-height", 1.65, "--out",
                   short.parent)


def test_damaged_folder(damaged_folder, tmp_path):
    folder, reason = damaged_folder
    assert_refused(1, reason, EVALUATE, folder, "--out", tmp_path)


@pytest.mark.parametrize("command", ["evaluate", "benchmark", "ablation"])
def test_two_sequences_of_one_name(short, tmp_path, command):
    (tmp_path / "short").mkdir()
    assert_refused(2, "have the same name", SCRIPTS / command, short, tmp_path / "short")


def test_ablation_wrong_arguments():
    assert_refused(2, "SEQ is missing", SCRIPTS / "ablation")


def called(tmp_path):
    """The calls of the stub tools, sorted: sequences are processed in parallel."""
    return sorted((tmp_path / "calls").read_text().splitlines())


@pytest.mark.parametrize("arguments, call", [
    (["--scenarios", "puddles", "night", "--ablation", "--set", "a=1", "--threads", "3", "--out", "o"],
     "evaluate_scenarios --ablation puddles night --set a=1 --out o --threads 3"),
    (["--faults", "black", "--seed", "7", "--threads", "3"], "evaluate_faults black --seed 7 --threads 3"),
])
def test_arguments_reach_the_tool(stub_tools, tmp_path, arguments, call):
    stubs = stub_tools("evaluate_scenarios", "evaluate_faults")
    run(EVALUATE, *arguments, **stubs)
    assert called(tmp_path) == [call]
    assert run(EVALUATE, arguments[0], "fails", check=False, **stubs).returncode == 1


def test_arguments_reach_each_run(stub_tools, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    stubs = stub_tools("run_sequence", "plot_run.py", "metrics_table.py")
    run(EVALUATE, "a", "b", "--camera-height", "2.5", "--out", "o", "--mask", "m.png", "--set", "c=1", **stubs)
    end = "--camera-height 2.5 --out o"
    assert called(tmp_path) == [
        "plot_run.py o/a", "plot_run.py o/b", f"run_sequence --mask m.png --set c=1 {tmp_path}/a {end}",
        f"run_sequence --mask m.png --set c=1 {tmp_path}/b {end}",
        f"run_sequence {tmp_path}/a --set c=1 {end} --check"]
    run(EVALUATE, "a", **stubs)
    assert f"run_sequence {tmp_path}/a --camera-height 1.65 --out results" in called(tmp_path)


def test_covariance(stub_tools, tmp_path):
    """The sequences that have results, and the scenarios."""
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    write_metrics(tmp_path / "o/scenarios/night", **METRICS)
    tools = ("run_sequence", "plot_run.py", "metrics_table.py", "evaluate_scenarios", "covariance_table.py")
    stubs = stub_tools(*tools)
    with open(tmp_path / "stub_build/devel/lib/ground_scale_vo/plot_run.py", "a", encoding="utf-8") as stub:
        stub.write('[[ $1 != o/a ]] || echo {} > "$1/metrics.json"\n')
    (tmp_path / "o/a").mkdir()
    run(EVALUATE, "a", "b", "--covariance", "--camera-height", "2.5", "--set", "c=1", "--out", "o", "--threads", 3,
        check=False, **stubs)
    assert called(tmp_path)[:2] == ["covariance_table.py o/a o/scenarios/night/",
                                    "evaluate_scenarios --set c=1 --out o/scenarios --threads 3"]
    assert f"run_sequence --set c=1 {tmp_path}/b --camera-height 2.5 --out o" in called(tmp_path)

    (tmp_path / "calls").unlink()
    run(EVALUATE, "--covariance", "--out", "o", **stubs)
    assert called(tmp_path) == ["covariance_table.py o/scenarios/night/",
                                "evaluate_scenarios --out o/scenarios --threads 2"]


def test_a_failed_sequence_is_reported(shortest, tmp_path):
    """The others are run, and its metrics of an earlier run do not remain."""
    folder, out = tmp_path / "empty", tmp_path / "out"
    folder.mkdir()
    write_metrics(out / "empty", **METRICS)
    done = run(EVALUATE, folder, shortest, "--out", out, check=False)
    assert done.returncode == 1 and "empty: has neither image_0" in done.stderr
    assert "1 of 2 sequences failed" in done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()[-2:]] == ["sequence", "shortest"]
    assert not (out / "empty/metrics.json").exists()


def test_ablation_runs_each_row(stub_tools, tmp_path):
    (tmp_path / "a").mkdir()
    rows = re.findall(r"^  '(.*): ?(.*)'$", (SCRIPTS / "ablation").read_text(), re.MULTILINE)
    assert len(rows) > 20
    stubs = stub_tools("run_sequence")
    done = run(SCRIPTS / "ablation", "a", "--camera-height", "2.5", "--out", "o", **stubs)
    expected = [" ".join([f"run_sequence {tmp_path}/a --camera-height 2.5 --out o/{i}",
                          *(f"--set {option}" for option in options.split())])
                for i, (_, options) in enumerate(rows)]
    assert called(tmp_path) == sorted(expected)
    labels = [label.rstrip(":") for label, _ in rows]  # the stub has written no results
    assert [line.split(" | ")[0][2:] for line in done.stdout.splitlines() if "failed" in line] == 2 * labels


def test_ablation_fails_with_a_run(stub_tools, tmp_path):
    (tmp_path / "a").mkdir()
    stubs = stub_tools("run_sequence")
    done = run(SCRIPTS / "ablation", "a", "--camera-height", " fails ", "--out", "o", check=False, **stubs)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "\n| **defaults** | failed | " in done.stdout


def write_metrics(folder, **metrics):
    folder.mkdir(parents=True)
    (folder / "metrics.json").write_text(json.dumps(metrics))
    return folder


# Each value differs from the others.
METRICS = {"frames": 40, "tracked_frames": 39, "lost_events": 2, "length_m": 12.34, "rle_percent": 0.57,
           "t_err_percent": 1.23, "r_err_deg_per_m": 0.0123, "t_err_true_length_percent": 0.45,
           "t_err_short_percent": 2.34, "scale_within_2_sigma": 0.95, "ms_total_median": 13.5, "ms_vo_median": 9.0,
           "ms_scale_median": 4.5, "scale_held_share": 0.25, "scale_error_median_percent": -0.35,
           "scale_error_spread_percent": 1.5, "height_bias_percent": 0.15}


def test_metrics_table(tmp_path):
    a = write_metrics(tmp_path / "a", **METRICS)
    b = write_metrics(tmp_path / "b", **{**METRICS, "t_err_percent": None})
    heading, *rows = run(tool("metrics_table.py"), a, b).stdout.splitlines()
    assert re.split("  +", heading) == [
        "sequence", "frames", "tracked", "lost", "length m", "rle %", "t_err %", "r_err deg/m", "t_err true length %",
        "t_err short %", "2 sigma", "ms median"]
    assert [row.split() for row in rows] == [
        [name, "40", "39", "2", "12.3", "0.57", t_err, "0.0123", "0.45", "2.34", "0.95", "13.5"]
        for name, t_err in (("a", "1.23"), ("b", "-"))]


def test_ablation_table(tmp_path):
    for row in range(2):
        for k, name in enumerate(("x", "y")):
            if (row, k) != (1, 1):
                write_metrics(tmp_path / str(row) / name, **{**METRICS, "rle_percent": 1.0 + row + 0.25 * k,
                                                             "ms_scale_median": 4.0 + k})
    lines = run(tool("ablation_table.py"), tmp_path, "--rows", "default", "changed", "--sequences", "x",
                "y").stdout.splitlines()
    assert "| default | 1.23 / 1.00 / 0.25 | 1.23 / 1.25 / 0.25 | 4.5 |" in lines
    assert "| changed | 1.23 / 2.00 / 0.25 | failed | 4.0 |" in lines
    assert "| default | 0.45 / -0.35 / 1.5 / 0.95 | 0.45 / -0.35 / 1.5 / 0.95 | +0.15 | +0.15 |" in lines
    rows = json.loads((tmp_path / "ablation.json").read_text())
    assert rows["default"]["y"]["rle_percent"] == 1.25 and rows["changed"]["y"] is None


def test_covariance_table_of_several_drives(tmp_path):
    def lengths(*values):
        return [{"length_m": length, "nees_per_dof": nees, "within_2_sigma": share}
                for length, (nees, share) in zip((10, 50, 100), values)]

    folders = [write_metrics(tmp_path / name, covariance_by_length=by_length, first_metric_pose_m=first,
                             first_scale_error_sigmas=scale)
               for name, by_length, first, scale in (
                   ("a", lengths((1.5, 0.9), (1.25, 0.8)), 2.5, -2.5), ("b", lengths((0.5, 1.0)), 7, 1.5),
                   ("c", None, None, None))]
    lines = run(tool("covariance_table.py"), *folders).stdout.splitlines()
    assert [line.split() for line in lines[1:5]] == [
        ["a", "1.50", "1.25", "-", "0.90", "0.80", "-", "2.50", "-2.50"],
        ["b", "0.50", "-", "-", "1.00", "-", "-", "7.00", "1.50"], ["c"] + 8 * ["-"],
        ["mean", "1.00", "1.25", "-", "0.95", "0.80", "-"]]
    assert lines[5] == ("first metric pose within 3 m: 0.33 of 3 drives; first scale with a known true scale "
                        "within 2 sigma: 0.33")


def test_files_of_a_run(evaluated):
    times = numpy.genfromtxt(evaluated / "timing.csv", delimiter=",", names=True)
    assert (times["decode"] > 0).all() and (times["vo_total"] > 0).all() and (times["scale_total"][10:] > 0).all()
    metrics = json.loads((evaluated / "metrics.json").read_text())
    assert metrics["camera_height_m"] == 1.65 and abs(metrics["height_bias_percent"]) < 3


def test_covariance_table(shortest, tmp_path):
    run(RUN_SEQUENCE, shortest, "--camera-height", 1.65, "--out", tmp_path)
    table = run(tool("covariance_table.py"), tmp_path / "shortest").stdout
    assert "NEES 10 m" in table and "\nshortest " in table and "of 1 drives" in table


def test_covariance_table_without_metrics(tmp_path):
    assert_refused(1, "metrics.json: cannot be read", tool("covariance_table.py"), tmp_path)


def test_full_disk(short, tmp_path):
    assert_refused(1, "poses.txt: cannot be written, File too large", RUN_SEQUENCE, short,
                   "--camera-height", 1.65, "--out", tmp_path, **on_full_disk(1))
    assert list((tmp_path / "short").iterdir()) == []


def test_plots_on_full_disk(shortest, tmp_path):
    run(RUN_SEQUENCE, shortest, "--camera-height", 1.65, "--out", tmp_path)
    results = tmp_path / "shortest"
    assert_refused(1, "cannot be drawn", tool("plot_run.py"), results, **on_full_disk(10))
    assert not [file for file in results.iterdir() if ".tmp" in file.name]
