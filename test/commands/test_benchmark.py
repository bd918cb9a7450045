"""scripts/benchmark: its reports are complete and consistent, its arguments are checked."""

import json

import benchmark_report
import check_benchmark
import numpy as np
import pytest
from conftest import SCRIPTS, assert_refused, run, table_rows, tool

BENCHMARK = SCRIPTS / "benchmark"


@pytest.mark.serial
def test_report(short, tmp_path):
    run(BENCHMARK, short, "--out", tmp_path, "--rates", "1,2", "--repeat", 2)
    check_benchmark.check(tmp_path / "short", frames=40, rates=[1, 2])


def write_run(folder, frame_s=0.01, **facts):
    """A run of four frames; odometry takes 4 ms, the scale stage 1 ms, the adjustment 20 ms in one of them."""
    folder.mkdir(parents=True)
    facts = {"frames": 4, "width": 800, "height": 248, "cores": 1, "settings": "", **facts}
    (folder / "run.json").write_text(json.dumps(facts))
    names = [name for _, name, _ in benchmark_report.STAGES if name not in ("publish", "vo_rest")]
    values = {"vo_total": 4, "scale_total": 1, "total": 5, "decode": 2, "vo_track": 3}
    times = [{**dict.fromkeys(names, 0), **values, "vo_bundle_adjustment": 20 * (i == 2),
              "vo_detect": 0.5 * (i == 1)} for i in range(4)]
    (folder / "timing.csv").write_text("frame," + ",".join(names) + "\n" + "".join(
        f"{i}," + ",".join(str(time[name]) for name in names) + "\n" for i, time in enumerate(times)))
    (folder / "usage.csv").write_text(
        "frame,features,decode_cpu,frame_cpu,publish,wall_s,cpu_s,rss_mb,peak_rss_mb\n" + "".join(
            f"{i},{100 + i},2,5,0.1,{frame_s * (i + 1)},{0.012 * (i + 1)},{50 + i},60\n" for i in range(4)))
    return benchmark_report.read_run(folder)


def test_figures_of_a_run(tmp_path):
    run_ = write_run(tmp_path / "one_core")
    figures = benchmark_report.run_figures(run_)
    assert figures["frames_per_second"] == pytest.approx(100) and figures["cpu_ms_per_frame"] == pytest.approx(12)
    assert (figures["decode_cpu_ms_per_frame"], figures["frame_cpu_ms_median"]) == (2, 5)
    assert figures["adjustment_cpu_ms"] == pytest.approx((12 - 2 - 5) / 0.25)
    assert (figures["features_median"], figures["peak_rss_mb"]) == (101.5, 60)
    assert figures["stages_ms"]["vo_bundle_adjustment"] == {"median": 20, "p95": 20, "p99": 20, "max": 20,
                                                            "share": 0.25, "mean": 5}
    assert figures["stages_ms"]["vo_rest"]["mean"] == pytest.approx(4 - 3 - 0.125)
    assert benchmark_report.figures(np.arange(101.0)) == {"median": 50, "p95": 95, "p99": 99, "max": 100}
    baseline = {"cpu": np.full(3, 2.5), "detect": np.full(3, 1.0), "total": np.full(3, 2.0)}
    ratio = benchmark_report.ratio_figures(run_, baseline)
    assert (ratio["median"], ratio["mean_with_adjustment"]) == pytest.approx((2, 4))
    assert ratio["mean_with_adjustment_and_its_detections"] == pytest.approx(10 / ((2.5 + 1.25 + 1.25) / 3))


def write_graph(file, frames):
    """Of this many images and one that is lost; the third is 30 ms late."""
    file.write_text("stamp,image,frame,scale,odometry,cpu_s,rss_mb,peak_rss_mb\n" + "".join(
        f"{10 + 0.1 * i},{7 + 0.05 * i},{7.02 + 0.05 * i},{7.03 + 0.05 * i},{7.04 + 0.05 * i + 0.03 * (i == 2)},"
        f"{1 + 0.01 * i},50,60\n" for i in range(frames)) + "10.4,nan,nan,nan,nan,0,0,0\n")


def test_figures_of_memory_and_graph(tmp_path):
    """Memory grows by 2 MiB in 1000 frames. Of five images one is lost."""
    frames = np.arange(1000)
    usage = {"rss_mb": 50 + 0.002 * frames, "peak_rss_mb": 0 * frames + 55}
    memory = benchmark_report.memory_figures({"usage": usage})
    assert memory["growth_mb_per_1000_frames"] == pytest.approx(2)
    assert (memory["rss_mb"][0]["frame"], memory["rss_mb"][-1]["rss_mb"]) == (99, pytest.approx(50 + 0.002 * 999))
    write_graph(tmp_path / "graph_2.csv", 4)
    figures, latencies = benchmark_report.graph_figures(tmp_path / "graph_2.csv", 5)
    assert (figures["rate"], figures["images"], figures["frames"], figures["dropped"]) == (2, 5, 4, 1)
    assert latencies == pytest.approx([40, 40, 70, 40])
    assert (figures["latency_ms"]["median"], figures["latency_ms"]["max"]) == pytest.approx((40, 70))
    assert figures["latency_to_frame_ms"]["median"] == pytest.approx(20)
    assert figures["cpu_ms_per_frame"] == pytest.approx(10) and figures["peak_rss_mb"] == 60


def test_files_of_the_report(tmp_path):
    folder = tmp_path / "drive"
    write_run(folder / "one_core")
    write_run(folder / "two_cores", cores=2, frame_s=0.005)
    write_run(folder / "long_drive", cores=2)
    (folder / "one_core/baseline.csv").write_text(
        "points,pyramid,detect,track,total,cpu\n" + 3 * "100,0.5,1.0,0.5,2.0,2.5\n")
    write_graph(folder / "graph_2.csv", 3)
    benchmark_report.report_benchmark(folder, 0.25)
    report, rows = json.loads((folder / "benchmark.json").read_text()), table_rows(folder / "benchmark.md")
    assert [(run["cores"], run["frames_per_second"]) for run in (report["one_core"], report["two_cores"])] == [
        (1, pytest.approx(100)), (2, pytest.approx(200))]
    # Processor time of all, of decoding, of the main thread; odometry, scale stage; memory.
    assert rows["1 core"] == [["100", "12.0", "2.00", "5.00", "4.00", "1.00", "60.0"]]
    assert rows["2 cores"] == [["200", "12.0", "2.00", "5.00", "4.00", "1.00", "60.0"]]
    # Images, dropped, odometry; latency: median, quantiles, maximum, to the image; processor time, memory.
    assert rows["2 x"] == [["4", "1", "3", "40.0", "67.0", "69.4", "70.0", "0", "10.0", "60.0"]]
    assert rows["mapping thread: bundle adjustment"] == [4 * ["20.0"] + ["25 %"]]


def test_files_of_the_growth_report(tmp_path):
    folder = tmp_path / "drive"
    for series, setting in (("features", "tracker/cell_size=0.018"), ("image", ""),
                            ("window", "bundle_adjustment/window=5 map/keyframes=10")):
        write_run(folder / "growth" / series / "01", settings=setting)
    benchmark_report.report_growth(folder, 0.25)
    rows = table_rows(folder / "growth.md")
    # Features; the stages, of which pyramid, track, align, pose, detect ran; main thread, adjustment, frame; memory.
    cells = ["102", "–", "3.00", "–", "–", "0.500", "–", "–", "–", "5.00", "20.0", "12.0", "60.0"]
    assert rows["0.018"] == rows["800x248"] == rows["5"] == [cells]


def test_targets():
    """Frames per second must be high, the others low. Decoding does not count."""
    report = {"one_core": {"cpu_ms_per_frame": 8, "decode_cpu_ms_per_frame": 3, "frames_per_second": 59},
              "two_cores": {"peak_rss_mb": 121},
              "memory": {"peak_rss_mb": 110, "growth_mb_per_1000_frames": None},
              "pipeline_over_baseline": {"median": 0.49, "mean_with_adjustment": 0.61},
              "graph": [{"rate": 1, "latency_ms": {"p99": 14, "max": 26}}, {"rate": 15, "dropped": 1}]}
    met = [target["met"] for target in benchmark_report.threshold_figures(report)]
    assert met == [True, False, True, False, False, None, True, False, False]


def test_a_failed_sequence_is_reported(stub_tools, tmp_path):
    (tmp_path / "a").mkdir()
    stubs = stub_tools("benchmark_sequence")
    done = run(BENCHMARK, "a", "--camera-height", "2.5", "--out", "o", check=False, **stubs)
    assert done.returncode == 1  # there are no files to report
    assert (tmp_path / "calls").read_text().splitlines()[0] == (
        f"benchmark_sequence {tmp_path}/a --camera-height 2.5 --out {tmp_path}/o/a/one_core --cores 1 --baseline")


@pytest.mark.long
def test_micro(tmp_path):
    run(BENCHMARK, "--micro", "--filter", "/(width:620|points:125|features:125)", "--out", tmp_path)
    assert "\n| bundleAdjustment " in (tmp_path / "micro.md").read_text()


def test_micro_benchmarks_are_in_milliseconds(tmp_path):
    """Processor time, or wall time of those that measure it themselves."""
    times = (("a/n:1", 2.0, "us"), ("a/n:2", 3.0, "ms"), ("b/n:1/manual_time", 4.0, "ns"),
             ("b/n:2/manual_time", 5.0, "s"))
    (tmp_path / "micro.json").write_text(json.dumps({
        "context": {"num_cpus": 2, "mhz_per_cpu": 3000, "load_avg": [0.5]},
        "benchmarks": [{"name": name, "real_time": 7, "cpu_time": time, "time_unit": unit}
                       for name, time, unit in times]}))
    benchmark_report.report_micro(tmp_path)
    lines = (tmp_path / "micro.md").read_text().splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("| ")]
    assert rows[0][1:] == ["n:1", "n:2"] and rows[2:] == [["a", "0.002", "3.00"], ["b", "0", "7000"]]


def test_growth(shortest, tmp_path):
    run(BENCHMARK, "--growth", shortest, "--out", tmp_path)
    assert "\n| bundle_adjustment/window " in (tmp_path / "shortest/growth.md").read_text()
    series = json.loads((tmp_path / "shortest/growth.json").read_text())["series"]
    assert [(run["width"], run["height"]) for run in series["image"]] == [
        (round(factor * 800), round(factor * 248)) for factor in (0.5, 1, 1.465, 2.07, 2.93, 4.14)]


def test_benchmark_sequence_records_what_it_measures(shortest, tmp_path):
    """cores: those that the process may use."""
    run(tool("benchmark_sequence"), shortest, "--camera-height", 1.65, "--cores", 1, "--repeat", 2, "--image-scale",
        0.5, "--set", "refine=false", "--out", tmp_path)
    assert json.loads((tmp_path / "run.json").read_text()) == {
        "frames": 23, "width": 400, "height": 124, "cores": 1, "settings": "refine=false"}


@pytest.mark.parametrize("text, arguments", [
    ("SEQ is missing", []),
    ("--camera-height", ["SHORT", "--camera-height", "0"]),
    ("'fast' is not a positive number", ["SHORT", "--rates", "1,fast"]),
    ("--repeat", ["SHORT", "--repeat", "0"]),
    ("takes no SEQ", ["--micro", "SHORT"]),
    ("own folder", ["SHORT", "--out", ".."]),
])
def test_wrong_arguments(short, text, arguments):
    arguments = [short if word == "SHORT" else word for word in arguments]
    assert_refused(2, text, BENCHMARK, *arguments, cwd=short)


@pytest.mark.parametrize("status, text, arguments", [
    (2, "none", ["--set", "none=1"]),
    (2, "tracker/cell_size", ["--set", "tracker/cell_size=7"]),
    (1, "may use", ["--cores", "1024"]),
])
def test_benchmark_sequence_wrong_arguments(short, tmp_path, status, text, arguments):
    assert_refused(status, text, tool("benchmark_sequence"), short, "--camera-height", 1.65, "--out",
                   tmp_path, *arguments)


def test_benchmark_sequence_damaged_folder(damaged_folder, tmp_path):
    folder, reason = damaged_folder
    assert_refused(1, reason, tool("benchmark_sequence"), folder, "--camera-height", 1.65, "--out",
                   tmp_path)
