"""The topic's section of docs/RESULTS.md: one table, one row or more a line, replaced line by line.

A comment after each table row's notes names its line, so that a rerun finds the rows it replaces.
"""

import datetime
import os
import platform
import re

from .tools import ROOT, output

FILE = ROOT / "docs" / "RESULTS.md"
HEAD = "# Results\n\nMeasured by `scripts/accept`; every row with the command that gives it.\n"
COLUMNS = "| asked | measured | met | notes | command | measured on |\n|---|---|---|---|---|---|\n"


def machine():
    """Processor, cores, memory, system, compiler."""
    model = platform.processor() or platform.machine()
    memory = ""
    try:
        cpu = open("/proc/cpuinfo", encoding="utf-8").read()
        model = re.search(r"model name\s*: (.*)", cpu).group(1)
        kib = re.search(r"MemTotal:\s+(\d+)", open("/proc/meminfo", encoding="utf-8").read())
        memory = f", {int(kib.group(1)) / 2**20:.0f} GiB"
    except (OSError, AttributeError):
        pass
    try:
        system = platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        system = platform.system()
    rustc = " ".join(output(["rustc", "--version"]).split()[:2])
    return f"{model}, {os.cpu_count()} cores{memory}, {system} ({platform.release()}), {rustc}"


def cell(text):
    return str(text).replace("|", "\\|").replace("\n", "<br>")


def replace(topic, order, name, rows):
    """Puts `rows` where the rows of line `name` were; `order` is that of all lines."""
    text = FILE.read_text(encoding="utf-8") if FILE.exists() else HEAD
    begin, end = f"<!-- begin {topic} -->", f"<!-- end {topic} -->"
    old = re.search(f"{re.escape(begin)}(.*?){re.escape(end)}", text, re.DOTALL)
    kept = {}
    for row in (old.group(1) if old else "").splitlines():
        found = re.search(r"<!-- (\S+) --> \|$", row)
        if found and found.group(1) != name:
            kept.setdefault(found.group(1), []).append(row)
    today = datetime.date.today().isoformat()
    command = f"`scripts/accept {topic} --only {name}`"
    kept[name] = [
        "| "
        + " | ".join(cell(c) for c in (row.asked, row.measured, row.verdict(), row.notes, command))
        + f" | {today} <!-- {name} --> |"
        for row in rows
    ]
    table = "".join(row + "\n" for line in order for row in kept.get(line, []))
    section = f"{begin}\n\n## {topic}\n\nMachine: {machine()}.\n\n{COLUMNS}{table}\n{end}"
    if old:
        text = text[: old.start()] + section + text[old.end() :]
    else:
        text = text.rstrip("\n") + "\n\n" + section + "\n"
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_text(text, encoding="utf-8")
