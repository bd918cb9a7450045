#!/usr/bin/python3
"""Checks that the relative links in these Markdown files lead to existing files and headings."""

import os
import re
import sys


def headings(path):
    """The anchors of a file: lower case, hyphens for spaces, no punctuation."""
    with open(path, encoding="utf-8") as stream:
        titles = re.findall(r"^#+ +(.*?) *$", stream.read(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def broken(path):
    with open(path, encoding="utf-8") as stream:
        links = re.findall(r"\]\(([^)\s]+)\)", stream.read())
    for link in links:
        if re.match(r"[a-z]+:", link):
            continue
        name, _, heading = link.partition("#")
        target = os.path.join(os.path.dirname(path), name) if name else path
        if not os.path.exists(target) or (heading and heading not in headings(target)):
            yield link


def main():
    found = [f"{path}: {link}" for path in sys.argv[1:] for link in broken(path)]
    print("\n".join(found))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
