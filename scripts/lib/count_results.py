#!/usr/bin/python3
"""Prints three numbers: the passed, failed and skipped test cases in the JUnit files below a folder.

usage: count_results.py FOLDER [PATTERN]

PATTERN: of the names of the files, default *.xml. An unreadable file counts as one failed case.
"""

import pathlib
import sys
import xml.etree.ElementTree as ElementTree


def main():
    passed = failed = skipped = 0
    pattern = sys.argv[2] if len(sys.argv) > 2 else "*.xml"
    for file in sorted(pathlib.Path(sys.argv[1]).rglob(pattern)):
        try:
            cases = list(ElementTree.parse(file).iter("testcase"))
        except ElementTree.ParseError:
            failed += 1
            continue
        for case in cases:
            if case.find("failure") is not None or case.find("error") is not None:
                failed += 1
            elif case.find("skipped") is not None or case.get("status") == "notrun":
                skipped += 1
            else:
                passed += 1
    print(passed, failed, skipped)


if __name__ == "__main__":
    main()
