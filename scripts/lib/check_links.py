#!/usr/bin/python3
"""Tells the relative links in these Markdown files that lead to no file or to no heading."""

import os
import re
import sys


def headings(path):
    """As a link names them: small letters, hyphens, no punctuation."""
    with open(path) as stream:
        titles = re.findall(r"^#+ +(.*?) *$", stream.read(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def broken(path):
    with open(path) as stream:
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
    print("\n".join(found) or "every link leads somewhere")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
