"""The command lines of tools and scripts: what they refuse. The drives and bags that the tools write."""

import os
import shutil

import numpy as np
import pytest
import rosbag
from bags import IMAGE, INFO
from conftest import (ROOT, SCRIPTS, assert_refused, camera_matrix, images_of, on_full_disk, on_terminal, poses_of,
                      rendered, run, tool)

TOOLS = sorted(file.stem for folder in ("src/tools", "simulation/tools") for file in (ROOT / folder).glob("*.cpp")
               if file.stem != "ground_truth_relay")


def command(name):
    return SCRIPTS / name if (SCRIPTS / name).exists() else tool(name)


def test_python_of_the_system():
    """ROS is installed for it; another one may be first in the path."""
    programs = [file for folder in ("scripts", "nodes") for file in (ROOT / folder).iterdir()
                if file.is_file() and file.suffix != ".html"]
    first_lines = {file.read_text().splitlines()[0] for file in programs}
    assert first_lines == {"#!/usr/bin/env bash", "#!/usr/bin/python3"}


@pytest.mark.parametrize("distribution, installed, found", [
    ("", {"one": "catkin"}, "one"),  # ROS One, not sourced
    ("", {"humble": "", "noetic": "catkin", "one": "catkin"}, "noetic"),
    ("one", {"noetic": "catkin", "one": "catkin"}, "one"),
    ("humble", {"humble": "", "one": "catkin"}, "one"),  # ROS 2 is sourced
    ("humble", {"humble": ""}, None)])
def test_ros_1_is_found(tmp_path, distribution, installed, found):
    for name, build_system in installed.items():
        (tmp_path / name / "share" / build_system).mkdir(parents=True)
        (tmp_path / name / "setup.bash").write_text(f"sourced={name}\n")
    script = f"unset ROS_ROOT; source {SCRIPTS}/lib/environment.sh; gsv_source_distribution; echo $sourced"
    environment = {**os.environ, "ROS_DISTRO": distribution, "gsv_opt_ros": str(tmp_path)}
    assert run("bash", "-euc", f"sourced=; {script}", env=environment).stdout.strip() == (found or "")


@pytest.mark.parametrize("answer, is_sure, installs", [("n\n", "", False), ("\n", "", True), ("", "yes", True)])
def test_packages_are_installed_after_a_question(tmp_path, answer, is_sure, installs):
    """apt is replaced: it only prints, and nothing is installed already."""
    (tmp_path / "apt-get").write_text("#!/bin/sh\necho $* >> $0.calls\necho 'Need to get 850 MB of archives.'\n")
    for name in ("dpkg-query", "sudo"):
        (tmp_path / name).write_text('#!/bin/sh\n[ $(basename $0) = dpkg-query ] || exec "$@"\n')
    for file in tmp_path.iterdir():
        file.chmod(0o755)
    script = f"source {SCRIPTS}/lib/environment.sh; PATH={tmp_path}:$PATH; gsv_setup && echo done || echo refused"
    output = on_terminal("bash", "-c", script, answer=answer, environment={
        **os.environ, "GROUND_SCALE_VO_YES": is_sure, "gsv_opt_ros": str(tmp_path), "TMPDIR": str(tmp_path)})
    assert "Need to get 850 MB" in output and ("continue?" in output) == (not is_sure)
    assert ("done" in output) == installs and ("refused" in output) != installs
    assert any(" -y" in call for call in (tmp_path / "apt-get.calls").read_text().splitlines()) == installs


@pytest.mark.parametrize("name", [*TOOLS, "demo", "evaluate", "package", "report"])
def test_help_and_unknown_option(name):
    assert name in run(command(name), "--help").stdout.split("\n\n")[0]
    assert_refused(2, "--nonsense", command(name), "--nonsense")


@pytest.mark.parametrize("status, text, words", [
    (2, "unknown scenario", "render_drive OUT/x --scenario none"),
    (2, "camera_height is 0, it must lie in", "render_drive OUT/x --camera-height 0"),
    (2, "unknown variant 'none'", "derive_drives DRIVE none --out OUT"),
    (1, "shortest_half already exists", "derive_drives DRIVE half --out OLD"),
    (1, "OUT/none", "kitti_to_bag OUT/none --out OUT/x.bag"),
    (1, "has neither image_0", "kitti_to_bag OUT --out OUT/x.bag"),
    (1, "exists already; --force", "kitti_to_bag DRIVE --out OLD/old.bag"),
    (1, "is not a regular file", "kitti_to_bag DRIVE --out OLD/pipe --force"),
    (2, "over the sequence", "run_sequence OLD/shortest --camera-height 1.65 --out OLD"),
    (2, "did you mean tracker/cell_size?", "run_sequence DRIVE --camera-height 2 --out OUT --set tracker/cel_size=1"),
    (2, "tracker/cell_size is 7", "evaluate_scenarios pitched --out OUT --set tracker/cell_size=7"),
    (1, "metrics.json: cannot be read", "metrics_table.py OUT"),
    (1, "old.bag exists already", "bag_recorder OLD/old.bag"),
    (1, "must be an absolute path: record:=$PWD/my.bag", "bag_recorder my.bag"),
    (2, "SEQ is missing", "evaluate --out OUT"),
    (1, "none: no such file or folder", "evaluate OUT/none --out OUT"),
    (2, "have the same name", "evaluate DRIVE OLD/shortest --out OUT"),
    (2, "is it in centimetres? If not", "run_sequence DRIVE --camera-height 30 --out OUT"),
    (2, "camera_height is 0", "evaluate DRIVE --out OUT --camera-height 0"),
    (2, "unknown scenario", "evaluate --scenarios none --out OUT"),
    (1, "there is no bag", "demo --bag OUT/none.bag"),
    (2, "--camera-height", "demo --camera-height 0"),
    (2, "--image camera/image needs --camera-height", "demo --image camera/image"),
    (2, "own folder", "demo --sequence DRIVE --out OLD"),  # OLD/shortest is a link to DRIVE
    (2, "over the bag", "demo --bag OLD/recorded/recorded.bag --out OLD"),
    (1, "exists already", "calibrate_height DRIVE --length 50 --length-sigma 0.1 --out OLD/old.bag"),
    (1, "there is no folder", "calibrate_height DRIVE --length 50 --length-sigma 0.1 --out OUT/none/height.yaml"),
    (1, "uncertain by", "calibrate_height DRIVE --length 12 --length-sigma 5"),
    (1, "m, on a road vehicle it is 0.2 to 5 m: is --length in metres?", "calibrate_height DRIVE --length 1200 --length-sigma 1"),
    (1, "old.bag: is not a bag that can be read", "calibrate_height OLD/old.bag --image /image --gps /fix"),
    (2, "one of --length", "calibrate_height DRIVE"),
    (2, "--length and --length-sigma go together", "calibrate_height DRIVE --length 50"),
    (2, "--to must be greater", "calibrate_height DRIVE --length 50 --length-sigma 0.1 --from 3 --to 2"),
])
def test_refuses(shortest, tmp_path, status, text, words):
    """OUT is an empty folder and stays so; what OLD contains is not replaced."""
    out, old = tmp_path / "out", tmp_path / "old"
    for folder in (out, old / "shortest_half", old / "recorded"):
        folder.mkdir(parents=True)
    (old / "shortest").symlink_to(shortest)
    for file in ("old.bag", "recorded/recorded.bag"):
        (old / file).write_text("other data")
    os.mkfifo(old / "pipe")
    kept = sorted(old.rglob("*"))

    def placed(word):
        return word.replace("OUT", str(out)).replace("OLD", str(old)).replace("DRIVE", str(shortest))

    name, *arguments = map(placed, words.split())
    assert_refused(status, placed(text), command(name), *arguments, cwd=out)
    assert not list(out.iterdir()) and sorted(old.rglob("*")) == kept
    assert (old / "old.bag").read_text() == "other data" and (old / "pipe").is_fifo()


@pytest.mark.parametrize("kib, words", [
    (10, "render_drive OUT/drive --frames 2"), (10, "derive_drives DRIVE half --out OUT"),
    (100, "kitti_to_bag DRIVE --out OUT/x.bag"), (1, "run_sequence DRIVE --camera-height 1.65 --out OUT")])
def test_full_disk(shortest, tmp_path, kib, words):
    name, *arguments = (word.replace("OUT", str(tmp_path)).replace("DRIVE", str(shortest)) for word in words.split())
    assert_refused(1, "cannot be written", tool(name), *arguments, **on_full_disk(kib))
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_render_drive(short, tmp_path):
    drive = rendered(tmp_path / "drive", "--camera-height", 2, "--speed", 5, "--rate", 20, "--curvature", 0,
                     "--slope", 0, "--suspension", 0, "--pitch", 0, "--size", "200x62", "--frames", 6)
    K, whole = camera_matrix(drive), camera_matrix(short)
    assert K[[0, 1], [0, 1]] == pytest.approx(whole[[0, 1], [0, 1]] / 4)
    assert K[:2, 2] == pytest.approx((whole[:2, 2] + 0.5) / 4 - 0.5)  # (0, 0) is the centre of a pixel
    assert np.loadtxt(drive / "times.txt") == pytest.approx(0.05 * np.arange(6))
    assert poses_of(drive / "poses.txt")[1] == pytest.approx(np.hstack([np.eye(3), [[0], [0], [0.25]]]))
    assert np.loadtxt(drive / "ground.txt") == pytest.approx(np.array([[2, 0, -1, 0]] * 6))


@pytest.mark.parametrize("variant, mounting", [
    ("roll5", ("--roll", np.radians(-5))), ("yaw8", ("--yaw", np.radians(8)))])
def test_turned_drive_as_rendered(data, tmp_path, variant, mounting):
    """The images and the ground truth agree with a camera that is mounted so."""
    steady = ("--frames", 2, "--suspension", 0, "--pitch", 0)
    level = rendered(data / "level", *steady)
    turned, expected = tmp_path / f"level_{variant}", rendered(tmp_path / "rendered", *steady, *mounting)
    run(tool("derive_drives"), level, variant, "--out", tmp_path)
    for table in ("poses.txt", "ground.txt", "times.txt"):
        assert np.allclose(np.loadtxt(turned / table), np.loadtxt(expected / table), atol=1e-6)
    left, top = (camera_matrix(expected) - camera_matrix(turned))[:2, 2].round().astype(int)
    for image, whole in zip(images_of(turned), images_of(expected)):
        height, width = image.shape
        part = whole[top:top + height, left:left + width]
        assert image.size > 0.5 * whole.size and np.corrcoef(image.ravel(), part.ravel())[0, 1] > 0.95


def test_derived_drives(gsv, shortest, tmp_path):
    run(tool("derive_drives"), shortest, "half", "crop640", "reverse", "every3", "dark", "pitch20", "--out", tmp_path)
    pitched = gsv.open_drive(tmp_path / "shortest_pitch20")  # the principal point is far from the centre of the images
    assert [image.shape for image, _ in pitched] == [(pitched.camera.height, pitched.camera.width)] * len(images_of(shortest))
    given, whole = images_of(shortest), camera_matrix(shortest)
    half, crop, reverse, every3, dark = (
        tmp_path / f"shortest_{name}" for name in ("half", "crop640", "reverse", "every3", "dark"))
    assert camera_matrix(half)[[0, 1], [0, 1]] == pytest.approx(whole[[0, 1], [0, 1]] / 2)
    assert camera_matrix(half)[:2, 2] == pytest.approx((whole[:2, 2] + 0.5) / 2 - 0.5)
    assert camera_matrix(crop) == pytest.approx(whole - [[0, 0, 80], [0, 0, 0], [0, 0, 0]])
    assert images_of(half)[0].shape == (124, 400) and np.array_equal(images_of(crop)[0], given[0][:, 80:720])
    assert all(np.array_equal(image, given[3 * i]) for i, image in enumerate(images_of(every3)))
    first, last = poses_of(shortest / "poses.txt")[[0, 11]]
    assert np.array_equal(images_of(reverse)[0], given[11])
    assert np.allclose(poses_of(reverse / "poses.txt")[11, :, 3], last[:, :3].T @ (first[:, 3] - last[:, 3]))
    assert np.all(np.diff(np.loadtxt(reverse / "times.txt")) > 0)
    assert np.mean(images_of(dark)) == pytest.approx(np.mean(given) / 4, rel=0.1)


def rotation_matrix(q):
    """The matrix of a quaternion."""
    cross = np.cross(np.eye(3), [q.x, q.y, q.z])
    return np.eye(3) + 2 * q.w * cross + 2 * cross @ cross


@pytest.mark.parametrize("start", [5.5, 0])
def test_kitti_to_bag(shortest, tmp_path, start):
    """A stamp of 0 means no stamp in ROS, so these bags begin at 1 s."""
    sequence, file = tmp_path / "sequence", tmp_path / "x.bag"
    shutil.copytree(shortest, sequence)
    stamps = start + np.loadtxt(shortest / "times.txt")
    np.savetxt(sequence / "times.txt", stamps)
    turned = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]])
    poses = [np.hstack([np.linalg.matrix_power(turned, i), [[i], [2 * i], [3 * i]]]) for i in range(12)]
    np.savetxt(sequence / "poses.txt", [pose.ravel() for pose in poses])
    file.write_text("other data")
    run(tool("kitti_to_bag"), sequence, "--out", file, "--force")
    messages = {}
    with rosbag.Bag(str(file)) as bag:
        for topic, message, _ in bag.read_messages():
            messages.setdefault(topic, []).append(message)
    assert set(messages) == {IMAGE, INFO, "/tf"} and [len(m) for m in messages.values()] == [12, 12, 12]
    for i, image, info, tf in zip(range(12), messages[IMAGE], messages[INFO], messages["/tf"]):
        transform, = tf.transforms
        for header in (image.header, info.header, transform.header):
            assert header.stamp.to_sec() == pytest.approx(stamps[i] + (0 if start else 1))
        assert image.header.frame_id == info.header.frame_id == "camera_gray_left"
        assert (transform.header.frame_id, transform.child_frame_id) == ("world", "camera_left")
        t = transform.transform.translation
        assert [t.x, t.y, t.z] == pytest.approx([i, 2 * i, 3 * i])
        assert rotation_matrix(transform.transform.rotation) == pytest.approx(poses[i][:, :3], abs=1e-6)
        assert np.array(info.P).reshape(3, 4)[:, :3] == pytest.approx(camera_matrix(shortest))
        assert not any(info.K)
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)
        assert np.array_equal(pixels, images_of(shortest)[i])
