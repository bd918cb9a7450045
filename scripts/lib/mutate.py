"""Mutation testing: builds the package with one planted defect at a time and runs its tests.

A mutation is a file test/mutations/MODULE/NAME.patch: a sentence that describes the defect, then the
output of `git diff` for files of src/ or include/. A line `Survives: REASON` before the diff accepts
that no test fails, for example because the mutated program is equivalent.

Called by scripts/test --mutate, which installs the packages. Without arguments it runs the mutations
of the files that changed since the branch left main (on main: since the parent commit) and of their
headers and tests.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MUTATIONS = Path("test/mutations")
BUILD = Path(os.environ.get("GROUND_SCALE_VO_MUTATE_BUILD", ROOT / "build/mutate"))
PREFIX = "_ctest_ground_scale_vo_"
# In the order of their run, after those of the mutated module. The rendered drives of
# test/drives are left out: they take minutes for each mutation.
UNIT_TESTS = ["common", "ros", "vo", "scale", "calibration", "evaluation", "integration"]
FUZZ_TARGETS = ["options_fuzz", "parameters_fuzz", "mono_vo_fuzz", "scale_recovery_fuzz"]
# Of the nodelets; the quick ones first.
ROSTESTS = ["scale", "graph", "images", "mask", "compressed", "time", "launch_files", "overload",
            "shutdown"]
LIBRARY = {module: "ground_scale_vo_core"
           for module in ("common", "vo", "scale", "metric_odometry")}
LIBRARY.update({module: "ground_scale_vo_nodelets" for module in ("ros", "nodelets")})


class MutationError(Exception):
    """A patch that cannot be used; the text names it."""


class Mutation:
    """One patch. Raises MutationError when it is malformed."""

    def __init__(self, path, root=ROOT):
        self.path = path
        self.name = str(path.relative_to(root / MUTATIONS).with_suffix(""))
        text = path.read_text(encoding="utf-8")
        header = text[:re.search(r"^(diff |--- |\Z)", text, re.MULTILINE).start()].strip()
        reason = re.search(r"^Survives: *(.*)", header, re.MULTILINE)
        self.accepted = reason.group(1) if reason else None
        self.files = [Path(file) for file in re.findall(r"^\+\+\+ b/(\S+)", text, re.MULTILINE)]
        description = re.sub(r"^Survives:.*", "", header, flags=re.MULTILINE | re.DOTALL).strip()
        if not description.endswith("."):
            raise MutationError(f"{path}: begins with a sentence that describes the defect")
        if self.accepted == "":
            raise MutationError(f"{path}: `Survives:` needs a reason")
        if not self.files or not all(file.parts[0] in ("src", "include") for file in self.files):
            raise MutationError(f"{path}: must change files of src/ or include/")

    def module(self):
        """Of its first file: the folder in src/, or the name of a file directly in it."""
        parts = self.files[0].parts
        return Path(parts[1] if parts[0] == "src" else parts[2]).stem

    def git_apply(self, folder, *options):
        """True if the patch applies to the tree in this folder."""
        # Otherwise paths are those of the repository that contains the folder.
        environment = dict(os.environ, GIT_CEILING_DIRECTORIES=str(folder.parent))
        return subprocess.run(["git", "apply", *options, self.path.resolve()], cwd=folder,
                              env=environment, stderr=subprocess.DEVNULL, check=False).returncode == 0


def key(path):
    """The same for a source file, its header and its test: module and name."""
    return path.parent.name, re.sub("_test$", "", path.stem)


def changed_files():
    """Relative to ROOT, including files that are not committed."""
    def git(*arguments):
        return subprocess.run(["git", *arguments], cwd=ROOT, check=False, text=True,
                              stdout=subprocess.PIPE, stderr=subprocess.DEVNULL).stdout.split()
    head = git("rev-parse", "HEAD")
    base = git("merge-base", "HEAD", "main") or git("merge-base", "HEAD", "origin/main")
    if not base or base == head:
        base = ["HEAD~1"]
    return [Path(file) for file in
            git("diff", "--name-only", *base) + git("ls-files", "--others", "--exclude-standard")]


def load(root=ROOT):
    """All mutations by name, and the sentences about unusable patches."""
    mutations, errors = [], []
    for path in sorted((root / MUTATIONS).rglob("*.patch")):
        try:
            mutation = Mutation(path, root)
            if not mutation.git_apply(root, "--check"):
                raise MutationError(f"{path}: does not apply; adapt it to the changed code")
            mutations.append(mutation)
        except MutationError as error:
            errors.append(str(error))
    return mutations, errors


def selected(mutations, files):
    """Those that change one of the files, whose test or header it is, or whose patch it is."""
    keys = {key(file) for file in files if file.suffix in (".cpp", ".hpp")}
    return [m for m in mutations if any(key(file) in keys for file in m.files)
            or m.path.relative_to(ROOT) in files]


def synchronise(target):
    """Copies the source tree to the target; unchanged files keep their time."""
    listed = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard"],
                            cwd=ROOT, check=True, text=True, stdout=subprocess.PIPE).stdout
    files = {Path(file) for file in listed.splitlines() if (ROOT / file).is_file()}
    for file in target.rglob("*"):
        if file.is_file() and file.relative_to(target) not in files:
            file.unlink()
    for file in files:
        restore(target, file)


def restore(target, file):
    source, copy = ROOT / file, target / file
    if copy.is_file() and copy.read_bytes() == source.read_bytes():
        return
    copy.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, copy)
    shutil.copymode(source, copy)


class Build:
    """The copy of the source tree and its build folder."""

    def __init__(self):
        self.source, self.folder = BUILD / "source", BUILD / "build"
        self.log = BUILD / "log.txt"
        (self.folder / "devel/lib/python3/dist-packages").mkdir(parents=True, exist_ok=True)
        self.source.mkdir(parents=True, exist_ok=True)
        self.environment = dict(os.environ, GTEST_FAIL_FAST="1",
                                GROUND_SCALE_VO_BUILD=str(self.folder))
        self.environment.pop("GROUND_SCALE_VO_DATA", None)
        synchronise(self.source)

    def run(self, command, **environment):
        """Runs a shell command in the build folder; its exit status and output."""
        setup = "[ ! -f devel/setup.bash ] || . devel/setup.bash; "
        done = subprocess.run(["bash", "-c", setup + command], cwd=self.folder, text=True, check=False,
                              env={**self.environment, **environment}, errors="replace",
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.log.write_text(done.stdout, encoding="utf-8")
        return done.returncode, done.stdout

    def configure(self):
        return self.run(f"cmake '{self.source}' -DCATKIN_ENABLE_TESTING=ON -DCMAKE_UNITY_BUILD=OFF "
                        "-DCMAKE_LINK_DEPENDS_NO_SHARED=ON -DPYTHON_EXECUTABLE=/usr/bin/python3 "
                        "-DPython3_EXECUTABLE=/usr/bin/python3")[0] == 0

    def make(self, *targets):
        jobs = os.environ.get("CMAKE_BUILD_PARALLEL_LEVEL", os.cpu_count())
        return self.run(f"cmake --build . --parallel {jobs} --target {' '.join(targets)}")[0] == 0

    def failure(self, test, gtest_filter="*", timeout=1500):
        """The name of the first failing test of an executable, or None."""
        status, output = self.run(f"ctest -R '^{PREFIX}{test}$' --output-on-failure "
                                  f"--no-tests=error --timeout {timeout}", GTEST_FILTER=gtest_filter)
        if status == 0:
            return None
        names = (re.findall(r"\[  FAILED  \] ([^\s,]+)", output) or
                 re.findall(r"\.rosunit-\w+/(\w+)\]\[FAILED\]", output))
        return names[0] if names else f"{test} ({'timeout' if 'Timeout' in output else 'crash'})"


def tests_of(mutation):
    """(test, filter) in the order of their run: the tests named like the file, those of its module,
    the others; of the nodelets, which have no unit tests, the rostests."""
    module = mutation.module()
    folder = "integration" if module == "metric_odometry" else module
    tests = []
    own = ROOT / "test" / folder / f"{mutation.files[0].stem}_test.cpp"
    if own.is_file():
        suites = set(re.findall(r"^TEST(?:_[FP])?\((\w+),", own.read_text(encoding="utf-8"),
                                re.MULTILINE))
        tests.append((f"gtest_{folder}_test",
                      ":".join(f"{suite}.*:*/{suite}.*" for suite in sorted(suites))))
    if module != "nodelets":
        names = [folder] + [name for name in UNIT_TESTS if name != folder]
        tests += [(f"gtest_{name}_test", "*") for name in names]
    tests += [(f"gtest_{name}", "*") for name in FUZZ_TARGETS]
    if module in ("ros", "nodelets"):
        tests += [(f"rostest_test_rostest_{name}_rostest.test", "*") for name in ROSTESTS]
    return tests


def targets_of(tests):
    """What to build for these tests; the rostests also start nodes and tools."""
    names = {re.sub("^gtest_", "", test) for test in tests if not test.startswith("rostest")}
    return sorted(names) + ["rostests", "all"] * any(test.startswith("rostest") for test in tests)


def run_mutation(build, mutation):
    """The test that detects the mutation, or None. Raises MutationError when it does not compile."""
    if not mutation.git_apply(build.source):
        raise MutationError("does not apply")
    try:
        tests = tests_of(mutation)
        is_header = any(file.suffix == ".hpp" for file in mutation.files)
        library = None if is_header else LIBRARY.get(mutation.module())
        if not build.make(*([library] if library else targets_of(test for test, _ in tests))):
            raise MutationError(f"does not compile, see {build.log}")
        for test, gtest_filter in tests:
            failed = build.failure(test, gtest_filter)
            if failed:
                return failed
        return None
    finally:
        for file in mutation.files:
            restore(build.source, file)


def run_all(mutations):
    """Runs the mutations and prints their results; the number of those that are not accepted."""
    build = Build()
    print(f"mutate: {len(mutations)} mutations, building without them", file=sys.stderr)
    tests = sorted({test for mutation in mutations for test, _ in tests_of(mutation)})
    if not build.configure() or not build.make(*targets_of(tests)):
        print(f"mutate: the build failed, see {build.log}", file=sys.stderr)
        return len(mutations)
    for test in tests:
        failed = build.failure(test)
        if failed:
            print(f"mutate: {failed} fails without a mutation, see {build.log}", file=sys.stderr)
            return len(mutations)
    unexplained = killed = 0
    for mutation in mutations:
        start = time.monotonic()
        try:
            test = run_mutation(build, mutation)
            result = f"killed by {test}" if test else "survived"
            killed += test is not None
            if test and mutation.accepted:
                result += ", but the patch says that it survives"
            elif mutation.accepted:
                result += f": {mutation.accepted}"
            is_explained = bool(test) != bool(mutation.accepted)
        except MutationError as error:
            result, is_explained = str(error), False
        unexplained += not is_explained
        print(f"{mutation.name}: {result} ({time.monotonic() - start:.0f} s)", flush=True)
    print(f"{killed} killed, {len(mutations) - killed - unexplained} survive with a reason, "
          f"{unexplained} unexplained")
    return unexplained


def main():
    parser = argparse.ArgumentParser(prog="scripts/test --mutate", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", metavar="FILE", type=Path,
                        help="source file, its header or test, or a patch (default: changed files)")
    parser.add_argument("--all", action="store_true", help="all mutations")
    parser.add_argument("--check", action="store_true",
                        help="only check that every patch is well-formed and applies")
    arguments = parser.parse_args()
    mutations, errors = load()
    for error in errors:
        print(error)
    if errors or arguments.check:
        return 1 if errors else 0
    if not arguments.all:
        files = [Path(os.path.relpath(file, ROOT)) for file in arguments.files] or changed_files()
        mutations = selected(mutations, files)
    if not mutations:
        print("mutate: there are no mutations of these files")
        return 0
    return 1 if run_all(mutations) else 0


if __name__ == "__main__":
    sys.exit(main())
