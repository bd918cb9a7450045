#!/usr/bin/python3
"""Prints three numbers: the passed, failed and skipped test cases in the JUnit files below a folder.

usage: count_results.py FOLDER [PATTERN]

PATTERN: of the names of the files, default *.xml. An unreadable file counts as one failed case. On standard error, the
failed cases with their messages.
"""

import pathlib
import sys
import xml.etree.ElementTree as ElementTree


def describe(case, failures):
    """Text that names a failed test case and has the messages of its <failure> and <error> elements."""
    name = ".".join(filter(None, (case.get("classname"), case.get("name"))))
    messages = "\n".join(failure.get("message", "") for failure in failures)
    return "\n    ".join([f"failed: {name}", *messages.splitlines()])


def main():
    passed = skipped = 0
    failed = []
    pattern = sys.argv[2] if len(sys.argv) > 2 else "*.xml"
    for file in sorted(pathlib.Path(sys.argv[1]).rglob(pattern)):
        try:
            cases = list(ElementTree.parse(file).iter("testcase"))
        except ElementTree.ParseError as error:
            failed.append(f"failed: {file} is no JUnit file: {error}")
            continue
        for case in cases:
            failures = case.findall("failure") + case.findall("error")
            if failures:
                failed.append(describe(case, failures))
            elif case.find("skipped") is not None or case.get("status") == "notrun":
                skipped += 1
            else:
                passed += 1
    print(passed, len(failed), skipped)
    for text in failed:
        print(text, file=sys.stderr)


if __name__ == "__main__":
    main()
