"""`ground_scale_vo run` over several drives."""

import json
import re
import shutil
import subprocess

import pytest
from conftest import CAMERA_HEIGHT, TIMEOUT_S, assert_refused, run, wait_until

pytest.importorskip("distributed")
NAMES = ("a", "b", "c", "d")
IMAGES = 12


@pytest.fixture
def drives(short, tmp_path):
    """Parts of the rendered drive."""
    for k, name in enumerate(NAMES):
        (tmp_path / name / "image_0").mkdir(parents=True)
        shutil.copy(short / "calib.txt", tmp_path / name)
        stamps = (short / "times.txt").read_text().splitlines()[3 * k:3 * k + IMAGES]
        (tmp_path / name / "times.txt").write_text("\n".join(stamps) + "\n")
        for i in range(IMAGES):
            shutil.copy(short / f"image_0/{3 * k + i:06}.png", tmp_path / name / f"image_0/{i:06}.png")
    return [tmp_path / name for name in NAMES]


def test_several_drives_give_the_same_as_each_alone(gsv_command, venv, drives, tmp_path):
    """Also when the process of one is killed in the middle."""
    words = ("--camera-height", CAMERA_HEIGHT, "--out")
    for drive in drives:
        assert gsv_command("run", drive, *words, tmp_path / "alone")[0] == 0
    command = [str(word) for word in (venv / "bin/ground_scale_vo", "run", *drives, *words, tmp_path / "many", "--jobs", 2)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        wait_until(lambda: subprocess.run(["pkill", "-KILL", "-o", "-P", str(process.pid), "-f", "execute"],
                                          check=False).returncode == 0, while_runs=process)
        output = process.communicate(timeout=TIMEOUT_S)[0]
    assert process.returncode == 0 and "[4/4]" in output, output
    for drive in drives:
        for file in ("poses.txt", "scale.csv"):
            alone, many = (tmp_path / folder / drive.name / file for folder in ("alone", "many"))
            assert alone.read_bytes() == many.read_bytes(), (drive, file)
    assert {entry.name for entry in (tmp_path / "many").iterdir()} == {*NAMES, "index.html"}

    (drives[0] / "calib.txt").write_text("damaged")  # this one alone is repeated
    stamps = [(tmp_path / "many" / name / "poses.txt").stat().st_mtime_ns for name in NAMES]
    done = run(*command, check=False)
    assert done.returncode == 1 and "3 of 4 drives are finished already" in done.stderr
    assert re.search("calib.txt", done.stdout)
    assert stamps == [(tmp_path / "many" / name / "poses.txt").stat().st_mtime_ns for name in NAMES]
    page = (tmp_path / "many/index.html").read_text()
    assert "3 of 4 drives" in page and all(f"{name}/" in page for name in NAMES)


def test_cluster_by_its_address(venv, drives, tmp_path):
    address_file = tmp_path / "scheduler.json"
    with subprocess.Popen(["dask-scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", address_file],
                          stderr=subprocess.DEVNULL) as scheduler:
        wait_until(address_file.exists, while_runs=scheduler)
        with subprocess.Popen([venv / "bin/python", "-m", "distributed.cli.dask_worker", "--scheduler-file", address_file,
                               "--nthreads", "1", "--no-dashboard"], stderr=subprocess.DEVNULL) as worker:
            address = json.loads(address_file.read_text())["address"]
            done = run(venv / "bin/ground_scale_vo", "run", *drives[:2], "--camera-height", CAMERA_HEIGHT, "--out",
                       tmp_path / "out", "--scheduler", address)
            worker.terminate()
        scheduler.terminate()
    assert "[2/2]" in done.stderr and (tmp_path / "out/b/poses.txt").exists()


def test_refusals(venv, drives, tmp_path):
    command = venv / "bin/ground_scale_vo"
    assert_refused(2, "two drives are called a", command, "run", drives[0], drives[0], "--camera-height", 1.65)
    assert_refused(2, "--jobs must be at least 1", command, "run", *drives, "--camera-height", 1.65, "--jobs", 0)
