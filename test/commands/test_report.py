"""scripts/report and derive_drives."""

import json

import matplotlib.image
import numpy
import pytest
from conftest import LONG, SCRIPTS, assert_refused, on_full_disk, run, tool

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


@pytest.mark.skipif(not LONG, reason="renders a fault drive and a scenario: scripts/test --long")
def test_faults_and_scenarios_are_collected(tmp_path):
    """From files as evaluate_faults and evaluate_scenarios write them."""
    for part in ("faults", "ablation"):
        (tmp_path / part).mkdir()
    (tmp_path / "faults/faults.txt").write_text(run(tool("evaluate_faults"), "darker").stdout)
    run("/usr/bin/python3", SCRIPTS / "report_figures.py", "faults", tmp_path)
    faults = json.loads((tmp_path / "faults.json").read_text())
    assert faults["drives"] == 1 and faults["kinds"]["darker"]["count"] == 1
    assert 0 < faults["max_error_percent"] < 5

    run(tool("evaluate_scenarios"), "camera_low", "--ablation", "--out", tmp_path / "ablation")
    run("/usr/bin/python3", SCRIPTS / "report_figures.py", "ablation", tmp_path)
    runs = json.loads((tmp_path / "ablation.json").read_text())["camera_low"]
    assert {"default", "paper", "features_only", "direct_only"} <= set(runs)
    assert runs["default"]["violated"] == "" and 0 < runs["default"]["rle_percent"] < 1.5


def test_consistency_intervals(monkeypatch):
    monkeypatch.syspath_prepend(SCRIPTS)
    import report_tables
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


@pytest.fixture(scope="module")
def level(data):
    run(RENDER, *STEADY, "--pitch", 0, data / "level")
    return data / "level"


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
