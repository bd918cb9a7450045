"""`ground_scale_vo run` over several drives. Each drive is a task of a Dask cluster and a process of its own, so the odometry
is as deterministic as alone, and what ends one drive ends no other."""

import argparse
import collections
import html
import json
import pathlib
import pickle
import shutil
import subprocess
import sys
import tempfile
from typing import Any, Dict, NamedTuple

from . import _core

FINISHED = "finished.json"  # in the results of a drive: what they belong to, and the exit status
ATTEMPTS = 3  # of a drive whose process or worker is killed
CHILD = """import pickle, sys
from ground_scale_vo import command_line
sys.argv, arguments = pickle.load(sys.stdin.buffer)
sys.exit(command_line.execute(command_line.run_drive, arguments))"""
PAGE = """<!DOCTYPE html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{title}</title><style>body{{font:16px sans-serif;margin:2em;color-scheme:light dark}}td{{padding:.3em 1em}}</style>
<h1>{title}</h1><table>{rows}</table></html>
"""
ROW = "<tr><td><a href='{name}/{page}'>{name}</a></td><td>{status}</td><td>{text}</td></tr>\n"


class Drive(NamedTuple):
    arguments: argparse.Namespace  # of the command for this drive alone
    name: str
    belongs_to: Dict[str, Any]  # the version, the options, and the state of every file that is read

    @property
    def folder(self) -> pathlib.Path:
        return self.arguments.out / self.name

    def finished(self):
        """The exit status and the text of an earlier run of the same command over the same files, or None."""
        try:
            earlier = json.loads((self.folder / FINISHED).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return (earlier["status"], earlier["text"]) if earlier["belongs_to"] == self.belongs_to else None


def state(path):
    """Number, total size and newest change of the files of a drive, or of one file."""
    stats = [file.stat() for file in (path.rglob("*") if path.is_dir() else [path]) if file.is_file()]
    return [str(path), len(stats), sum(one.st_size for one in stats), max((one.st_mtime_ns for one in stats), default=0)]


def drives(arguments):
    names = [_core.result_name(str(path)) for path in arguments.inputs]
    twice = [name for name, count in collections.Counter(names).items() if count > 1]
    if twice:
        raise ValueError(f"two drives are called {twice[0]} and would share a folder of results")
    options = {name: value.resolve() if isinstance(value, pathlib.Path) else value
               for name, value in vars(arguments).items() if name not in ("inputs", "jobs", "scheduler")}
    for path, name in zip(arguments.inputs, names):
        one = argparse.Namespace(**options, input=path.resolve())
        belongs_to = {"version": _core.__version__, **{
            key: state(pathlib.Path(value)) if isinstance(value, pathlib.Path) or key in ("gps", "speed") and value else value
            for key, value in sorted(vars(one).items()) if key != "out"}}
        yield Drive(one, name, json.loads(json.dumps(belongs_to)))


def process(drive, argv):
    """The exit status and what was printed. The results appear under their name when they are complete."""
    drive.arguments.out.mkdir(parents=True, exist_ok=True)
    temporary = pathlib.Path(tempfile.mkdtemp(prefix=f".{drive.name}.", dir=drive.arguments.out))
    try:
        one = argparse.Namespace(**{**vars(drive.arguments), "out": temporary})
        child = subprocess.run([sys.executable, "-c", CHILD], input=pickle.dumps((argv, one)), stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT, check=False)
        text = child.stdout.decode(errors="replace").strip().replace(str(temporary), str(drive.arguments.out))
        if child.returncode < 0:
            raise RuntimeError(f"the process of {drive.name} was killed by signal {-child.returncode}")
        written = temporary / drive.name
        if written.is_dir():
            (written / FINISHED).write_text(json.dumps(
                {"belongs_to": drive.belongs_to, "status": child.returncode, "text": text}), encoding="utf-8")
            if drive.folder.exists():
                drive.folder.rename(temporary / "replaced")
            written.rename(drive.folder)
        return child.returncode, text
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_index(out, results):
    """index.html beside the drives. results: exit status and text by the name of the drive."""
    rows = "".join(ROW.format(name=html.escape(name), status="ok" if status == 0 else f"exit status {status}",
                              page="report.html" if (out / name / "report.html").exists() else "",
                              text=html.escape(text.splitlines()[-1] if text else ""))
                   for name, (status, text) in sorted(results.items()))
    good = sum(status == 0 for status, _ in results.values())
    (out / "index.html").write_text(PAGE.format(title=f"{good} of {len(results)} drives", rows=rows), encoding="utf-8")


def run(arguments):
    """The exit status of the worst drive."""
    try:
        import distributed
    except ImportError:
        raise ValueError("several drives need the Python module distributed (Debian: python3-distributed)") from None
    tasks = list(drives(arguments))
    earlier = {task.name: task.finished() for task in tasks}
    results = {name: result for name, result in earlier.items() if result}
    print(f"{len(results)} of {len(tasks)} drives are finished already", file=sys.stderr, flush=True)
    cluster = arguments.scheduler or distributed.LocalCluster(  # threads: each task waits for its own process
        n_workers=arguments.jobs, threads_per_worker=1, processes=False, dashboard_address=None)
    with distributed.Client(cluster) as client:
        futures = {client.submit(process, task, sys.argv, pure=False, retries=ATTEMPTS - 1): task
                   for task in tasks if task.name not in results}
        for future in distributed.as_completed(futures):
            name = futures[future].name
            error = future.exception()
            results[name] = (1, f"{name}: {error}") if error else future.result()
            print(f"[{len(results)}/{len(tasks)}] {results[name][1]}", file=sys.stderr, flush=True)
    write_index(arguments.out, results)
    for name, (status, text) in sorted(results.items()):
        print(f"{status}  {text.splitlines()[-1] if text else name}")
    return max(status for status, _ in results.values())
