"""scripts/test counts its test cases and fails when one fails. Runs a copy, with a ctest and a pre-commit that
write given results."""

import os
import shutil

import pytest
from conftest import SCRIPTS, run, write_program

CASE = '<testcase name="a"/>'
# Of a JUnit file.
KINDS = {
    "passed": f"<testsuite>{CASE}</testsuite>",
    "failed": f'<testsuite>{CASE}<testcase name="b" classname="A"><failure message="a.cpp:1&#x0A;not 2"/>'
              '</testcase></testsuite>',
    "error": f'<testsuite>{CASE}<testcase name="b"><error/></testcase></testsuite>',
    "skipped": '<testsuite><testcase name="b"><skipped/></testcase>'
               '<testcase name="c" status="notrun"/></testsuite>',
    "truncated": f'<testsuite>{CASE}<testcase name="b">',
}


@pytest.fixture
def tree(tmp_path):
    """The copy, with a build folder that counts as built, one passing command test, and a passing hook."""
    (tmp_path / "scripts/lib").mkdir(parents=True)
    shutil.copy(SCRIPTS / "test", tmp_path / "scripts")
    for name in ("environment.sh", "packages.txt", "count_results.py"):
        shutil.copy(SCRIPTS / "lib" / name, tmp_path / "scripts/lib")
    (tmp_path / "CMakeLists.txt").touch()
    (tmp_path / "test/commands").mkdir(parents=True)
    shutil.copy(SCRIPTS.parent / "test/commands/pytest.ini", tmp_path / "test/commands")
    command_tests(tmp_path, "def test_a(): pass")
    setup = tmp_path / "build/devel/setup.bash"
    write_program(setup, f"PATH={tmp_path}/bin:$PATH")
    write_program(tmp_path / "bin/pre-commit", "echo hook..................Passed")
    ctest(tmp_path, "passed")
    return tmp_path


def command_tests(tree, text):
    (tree / "test/commands/test_x.py").write_text(
        f"import pytest\n{text}\n@pytest.mark.serial\ndef test_alone(): pass\n")


def ctest(tree, *kinds, status=0):
    """One that lists a test of the part it is asked for, and writes a result file of each of these KINDS for it: both
    parts run at the same time, and each counts its own files."""
    results = "".join(f"echo '{KINDS[kind]}' > $folder/$part-{kind}.xml\n" for kind in kinds)
    write_program(tree / "bin/ctest", f"""
folder=$GROUND_SCALE_VO_BUILD/test_results/ground_scale_vo
part=gtest
[[ $* != *rostest* ]] || part=rosunit
if [[ $1 == -N ]]; then
  echo "Test #1: _ctest_${{part/rosunit/rostest}}"
  exit
fi
{results}exit {status}""")


def lines(tree, *arguments, status):
    """Printed by scripts/test, which ends with this status."""
    done = run(tree / "scripts/test", *arguments, check=False,
               env={**os.environ, "GROUND_SCALE_VO_BUILD": str(tree / "build")})
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout.splitlines()


def last_line(tree, *arguments, status):
    return lines(tree, *arguments, status=status)[-1]


def test_all_parts_are_counted(tree):
    """Unit tests and rostests one each, command tests one in parallel and one alone, one hook."""
    assert last_line(tree, status=0) == "5 passed, 0 failed, 0 skipped"


def test_long_tests_are_counted(tree):
    """After the default tests: drives and fuzz inputs; shutdown and one hour; the marked command tests."""
    command_tests(tree, "def test_a(): pass\n@pytest.mark.long\ndef test_b(): assert False")
    assert last_line(tree, "unit", "--long", status=0) == "3 passed, 0 failed, 0 skipped"
    assert last_line(tree, "rostest", "--long", status=0) == "3 passed, 0 failed, 0 skipped"
    assert last_line(tree, "commands", "--long", status=1) == "2 passed, 1 failed, 0 skipped"


def test_long_tests_are_left_out_when_time_is_short(tree):
    printed = lines(tree, "unit", "rostest", "--long", "--minutes", 30, status=0)
    assert printed[-2:] == ["left out, would take longer than --minutes 30: drive of one hour",
                            "5 passed, 0 failed, 0 skipped"]


def test_failures_of_each_part_are_counted(tree):
    """Also those of the unit tests, which run in the background."""
    ctest(tree, "failed", status=8)
    assert last_line(tree, "unit", "rostest", status=1) == "2 passed, 2 failed, 0 skipped"


def test_failures_are_named_at_the_end(tree):
    """With the messages of their results."""
    ctest(tree, "failed", "truncated", status=8)
    write_program(tree / "bin/pre-commit", "echo a b....Failed; exit 1")
    command_tests(tree, "def test_a(): assert 1 == 2")
    failures = lines(tree, status=1)[-12:-1]
    truncated = "is no JUnit file: no element found: line 2, column 0"
    folder = tree / "build/test_results/ground_scale_vo"
    assert sorted(failures) == sorted([
        "failed: A.b", "    a.cpp:1", "    not 2", f"failed: {folder}/gtest-truncated.xml {truncated}",
        "failed: A.b", "    a.cpp:1", "    not 2", f"failed: {folder}/rosunit-truncated.xml {truncated}",
        "failed: test_x.test_a", "    assert 1 == 2", "failed: hook a b"])


def test_what_has_no_failed_case_is_named_at_the_end(tree):
    ctest(tree, "passed", status=8)
    write_program(tree / "bin/pre-commit", "exit 1")
    (tree / "test/commands/conftest.py").write_text("def pytest_sessionfinish(session): session.exitstatus = 3")
    assert sorted(set(lines(tree, status=1)[-6:-1])) == [
        "failed: a part without test cases",
        "failed: a test executable of part rostest without a failed case, see its output",
        "failed: a test executable of part unit without a failed case, see its output",
        "failed: pytest, with status 3, see its output"]


@pytest.mark.parametrize("kinds, ctest_status, status, line", [
    (["passed", "skipped"], 0, 0, "1 passed, 0 failed, 2 skipped"),
    (["failed", "error", "truncated"], 0, 1, "2 passed, 3 failed, 0 skipped"),
    (["failed"], 8, 1, "1 passed, 1 failed, 0 skipped"),
    (["passed"], 8, 1, "1 passed, 1 failed, 0 skipped"),
    ([], 0, 1, "0 passed, 1 failed, 0 skipped"),
], ids=["skipped", "failed", "counted_once", "crash", "no_tests"])
def test_unit_tests(tree, kinds, ctest_status, status, line):
    ctest(tree, *kinds, status=ctest_status)
    assert last_line(tree, "unit", status=status) == line


@pytest.mark.parametrize("text, arguments, status, line", [
    ("def test_a(): assert False\n@pytest.mark.serial\ndef test_b(none): pass", [], 1,
     "1 passed, 2 failed, 0 skipped"),
    ("def test_a(): pass\ndef test_b(): assert False", ["--filter", "test_a or alone"], 0,
     "2 passed, 0 failed, 0 skipped"),
], ids=["failed", "filter"])
def test_command_tests(tree, text, arguments, status, line):
    command_tests(tree, text)
    assert last_line(tree, "commands", *arguments, status=status) == line


def test_command_tests_that_cannot_start(tree):
    """With --filter, a part without test cases is no failure."""
    (tree / "test/commands/conftest.py").write_text("raise RuntimeError")
    assert last_line(tree, "commands", "--filter", "a", status=1) == "0 passed, 2 failed, 0 skipped"


def test_hooks(tree):
    write_program(tree / "bin/pre-commit",
                  "echo a....Passed; echo b....Failed; echo 'c....(no files to check)Skipped'; exit 1")
    assert last_line(tree, "unit", "lint", status=1) == "2 passed, 1 failed, 1 skipped"


def test_failed_build(tree):
    environment = {name: value for name, value in os.environ.items() if name != "GROUND_SCALE_VO_BUILD"}
    done = run(tree / "scripts/test", "unit", check=False, env={**environment, "CMAKE_PREFIX_PATH": ""})
    assert done.returncode == 1 and done.stdout.splitlines()[-1] == "0 passed, 1 failed, 0 skipped"


@pytest.mark.parametrize("arguments, message", [
    (["--sanitize", "memory"], "--sanitize must be one of"),
    (["--sanitize"], "--sanitize must be one of"),
    (["--sanitize", "thread", "--coverage"], "--sanitize and --coverage exclude each other"),
    (["--filter"], "--filter needs a value"),
    (["--long", "--minutes", "many"], "--minutes needs a whole number"),
    (["--minutes", "40"], "--minutes is only for --long"),
    (["unti"], "unknown option or part 'unti'"),
], ids=["list", "no_list", "both", "no_filter", "minutes", "not_long", "part"])
def test_wrong_arguments(tree, arguments, message):
    done = run(tree / "scripts/test", *arguments, check=False)
    assert done.returncode == 2 and message in done.stderr
