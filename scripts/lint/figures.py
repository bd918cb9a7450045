#!/usr/bin/python3
"""Checks the figures and tables in README and docs against docs/results.json.

usage: scripts/lint/figures.py [--write] [ROOT]

<!--=KEY-->TEXT<!--=--> cites a figure or a table. KEY is its path in docs/results.json, such as
faults.max_error_percent, or in what scripts/report_tables.py derives from it (summary.*, tables.*); a Python
format may follow, such as <!--=KEY .1f-->. --write replaces the texts and docs/results.md.

In README.md and docs/explanation, a table with decimal numbers that is not cited must follow a paragraph
that begins with "*Experiment of YYYY-MM-DD, version COMMIT", "*Experiments of YYYY-MM-DD to YYYY-MM-DD,
versions COMMIT to COMMIT" or "*Published".
"""

import json
import pathlib
import re
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import report_tables  # noqa: E402

CITATION = re.compile(r"<!--=([\w.]+)(?: ([+.\w]+))?-->(.*?)<!--=-->", re.DOTALL)
SOURCE = re.compile(r"\*(Experiments? of \d{4}-\d\d-\d\d( to \d{4}-\d\d-\d\d)?, versions? [0-9a-f]{7}|Published)\b")


def figure(figures, key):
    value = figures
    for name in key.split("."):
        value = value[name]
    if isinstance(value, (dict, list)):
        raise KeyError(key)
    return value


def filled(text, figures, missing):
    """The text with all citations as in the figures. Keys that do not exist are appended to missing."""
    def cite(match):
        key, form, _ = match.groups()
        try:
            value = report_tables.number(figure(figures, key), form or ".2f")
        except (KeyError, TypeError, ValueError):
            missing.append(key)
            return match[0]
        if key.startswith("tables."):
            value = f"\n{value}\n"
        return match[0][:match.start(3) - match.start()] + value + "<!--=-->"
    return CITATION.sub(cite, text)


def undated_tables(text):
    """The first lines of tables with decimal numbers that are neither cited nor follow their source."""
    before = ""
    for paragraph in re.split(r"\n\s*\n", CITATION.sub("", text)):
        lines = [line for line in paragraph.splitlines() if line.startswith("|")]
        if any(re.search(r"\d\.\d", line) for line in lines) and not SOURCE.match(before):
            yield lines[0]
        before = paragraph.strip()


def pages(root):
    yield from (root / "README.md", root / "CONTRIBUTING.md")
    yield from sorted({*(root / "docs").rglob("*.md"), root / "docs/results.md"})


def main():
    arguments = sys.argv[1:]
    write = "--write" in arguments
    rest = [argument for argument in arguments if argument != "--write"]
    root = pathlib.Path(rest[0]) if rest else pathlib.Path(__file__).resolve().parents[2]
    results = json.loads((root / "docs/results.json").read_text(encoding="utf-8"))
    try:
        figures = report_tables.derived(results)
    except (KeyError, TypeError) as error:
        sys.exit(f"docs/results.json: a figure that a table needs is missing or no number: {error}")
    generated = root / "docs/results.md"
    found = []
    for path in pages(root):
        name = path.relative_to(root)
        old = path.read_text(encoding="utf-8") if path.exists() else ""
        missing = []
        new = report_tables.page(figures) if path == generated else filled(old, figures, missing)
        found += [f"{name}: docs/results.json has no figure {key}" for key in missing]
        if path != generated and name.parts[:2] in (("README.md",), ("docs", "explanation")):
            found += [f"{name}: a table without a source: {line}" for line in undated_tables(old)]
        if new != old and write:
            path.write_text(new, encoding="utf-8")
        elif new != old:
            lines = [line for line in old.splitlines() if line not in new.splitlines()]
            found.append(f"{name}: differs from docs/results.json, run scripts/lint/figures.py --write: "
                         f"{lines[0] if lines else ''}")
    print("\n".join(found))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
