"""Running commands, building the project, installing what assets are read with."""

import functools
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from .line import Row

ROOT = Path(__file__).resolve().parent.parent.parent
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
#: Everything written here: bakes, virtual environment, npm packages.
WORK = TARGET / "accept"


def run(command, **options):
    """Runs a command; its output is shown only when it fails."""
    done = subprocess.run(
        [str(c) for c in command],
        cwd=options.pop("cwd", ROOT),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        **options,
    )
    if done.returncode:
        tail = "\n".join((done.stdout + done.stderr).strip().splitlines()[-8:])
        raise RuntimeError(f"{' '.join(map(str, command))}: exit code {done.returncode}: {tail}")
    return done.stdout


def output(command, **options):
    return run(command, **options).strip()


@functools.cache
def build():
    """Everything that measures, built at once: packages built one by one would differ in features."""
    run(["cargo", "build", "--release", "--workspace", "--bins", "--examples"])


def baker():
    """The optimised command."""
    build()
    return TARGET / "release" / "lightkiln"


def example(name):
    """An optimised example."""
    build()
    return TARGET / "release" / "examples" / name


def figures(*arguments):
    """Rows that `examples/accept` prints."""
    return rows_of(run([example("accept"), *arguments]))


def rows_of(text):
    """The JSON objects among lines of output."""
    return [Row(**json.loads(line)) for line in text.splitlines() if line.startswith("{")]


def scenes_folder():
    """The shared scenes, or None."""
    given = os.environ.get("LIGHTKILN_SCENES")
    for folder in [Path(given)] if given else [ROOT / "../shared/scenes", ROOT / "../../shared/scenes"]:
        if (folder / "manifests").is_dir():
            return folder.resolve()
    return None


def relocated(manifest, folder):
    """A copy of `manifest` in `folder` whose scene paths are absolute and whose output is `folder/out`."""
    text = manifest.read_text(encoding="utf-8")
    home = manifest.resolve().parent
    text = re.sub(
        r'^(\s*path\s*=\s*)"([^"]*)"',
        lambda m: f'{m.group(1)}"{(home / m.group(2)).resolve()}"',
        text,
        flags=re.MULTILINE,
    )
    text, replaced = re.subn(
        r'^(\s*dir\s*=\s*)"[^"]*"', r'\1"out"', text, count=1, flags=re.MULTILINE
    )
    if not replaced:
        text = '[output]\ndir = "out"\n\n' + text
    folder.mkdir(parents=True, exist_ok=True)
    copy = folder / "pipeline.toml"
    copy.write_text(text, encoding="utf-8")
    return copy


def python_with(*packages):
    """A Python that has PyPI `packages`."""
    home = WORK / "venv"
    python = home / "bin" / "python"
    if not python.exists():
        run([sys.executable, "-m", "venv", home])
    missing = [p for p in packages if not (home / f".has-{p}").exists()]
    if missing:
        run([python, "-m", "pip", "install", "--quiet", *missing])
        for package in missing:
            (home / f".has-{package}").touch()
    return python


def npm_folder(*packages):
    """A folder with npm `packages` installed."""
    home = WORK / "npm"
    home.mkdir(parents=True, exist_ok=True)
    missing = [p for p in packages if not (home / "node_modules" / p).is_dir()]
    if missing:
        run(["npm", "install", "--silent", "--no-audit", "--no-fund", "--prefix", home, *missing])
    return home


def debian(command, package):
    """A command of a Debian package, installed if absent."""
    if not shutil.which(command):
        root = [] if os.geteuid() == 0 else ["sudo", "-n"]
        quiet = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
        run([*root, "apt-get", "update", "-q"], env=quiet)
        run([*root, "apt-get", "install", "-y", "-q", "--no-install-recommends", package], env=quiet)
    return command
