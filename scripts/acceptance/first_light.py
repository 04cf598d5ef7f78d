"""The lines of `first-light`: one technique through every stage."""

import filecmp
import json
import os
import shutil
import tempfile
import time
from pathlib import Path

from . import bakes, readers
from .line import Line, Row
from .tools import ROOT, TARGET, WORK, baker, example, figures, rows_of, run

#: Median relative RMS promised for the worked scenes.
TARGETS = {"box": 0.05, "chamber": 0.08}
#: Most memory of a bake, bytes.
MEMORY = 2 << 30


def clone():
    """The README's two commands in a bare clone, with nothing built before."""
    rows = []
    with tempfile.TemporaryDirectory(prefix="lightkiln-") as folder:
        home = Path(folder) / "clone"
        run(["git", "clone", "--quiet", ROOT, home])
        environment = {**os.environ, "CARGO_TARGET_DIR": f"{folder}/target"}
        for command in (["cargo", "run", "--release", "--", "bake"], ["./scripts/test"]):
            asked = f"bare clone: `{' '.join(command)}`"
            started = time.monotonic()
            try:
                run(command, cwd=home, env=environment)
                rows.append(Row(asked, f"{time.monotonic() - started:.0f} s", True))
            except RuntimeError as error:
                rows.append(Row(asked, "failed", False, str(error)))
    return rows


def compared():
    """PRM at defaults against the reference over 64 lamp poses."""
    out = bakes.worked()
    run(
        [baker(), "verify", "--manifest", bakes.manifest(), "--poses", 64, "--points", 128]
        + ["--paths", 1024]
    )
    rows = []
    for scene, target in TARGETS.items():
        asked = f"{scene}, 64 poses: median relative RMS of indirect irradiance {target:.0%} or less"
        file = out / scene / "verify.json"
        if not file.exists():
            rows.append(Row(asked, "no such scene", False))
            continue
        found = json.loads(file.read_text(encoding="utf-8"))
        poses = sorted(found["poses"], key=lambda p: p["relative_rms"])
        worst, middle = poses[-1], poses[len(poses) // 2]
        rows.append(
            Row(
                asked,
                f"median {found['median']:.2%}, worst {found['worst']:.2%}",
                found["median"] <= target,
                f"worst pose +-{worst['interval']:.2%} (95 %), bias {worst['relative_bias']:+.2%}, "
                f"lamp at {[round(x, 2) for x in worst['lamp']]} m, "
                f"near a surface: {'yes' if worst['near_surface'] else 'no'}; median pose "
                f"+-{middle['interval']:.2%}, bias {middle['relative_bias']:+.2%}; median near "
                f"surfaces {found['median_near']:.2%}; reference noise median "
                f"{sorted(p['reference_noise'] for p in poses)[len(poses) // 2]:.2%}, worst pose "
                f"{worst['reference_noise']:.2%}; 128 points, 1024 paths",
            )
        )
    return rows


def replayed():
    """Gather time over the time its own rays take alone; the other stages apart."""
    rows = []
    sources = [(bakes.manifest(), scene) for scene in bakes.SCENES]
    pandora = bakes.shared("pandora")
    if pandora is None:
        rows.append(Row("pandora: gather over replay", "absent", None))
    else:
        sources.append((pandora, "pandora"))
    for file, scene in sources:
        for row in figures("replay", file, scene):
            seconds, _, timings = bakes.measured_bake(file)
            row.notes += f"; whole bake {seconds:.1f} s: {bakes.stages(timings, scene)}"
            rows.append(row)
    return rows


def same_bytes():
    """Assets and index do not depend on the number of threads."""
    folders = {}
    for threads in (1, 2, 7):
        file = bakes.manifest()
        bakes.measured_bake(file, threads)
        kept = WORK / "threads" / str(threads)
        shutil.rmtree(kept, ignore_errors=True)
        shutil.copytree(file.parent / "out", kept)
        folders[threads] = kept
    # Seconds differ from run to run, and are neither asset nor index.
    listed = sorted(
        p.relative_to(folders[1])
        for p in folders[1].rglob("*")
        if p.is_file() and p.name not in ("timings.json", "verify.json", "verify.html")
    )
    different = [
        f"{path} at {threads}"
        for path in listed
        for threads in (2, 7)
        if not (folders[threads] / path).is_file()
        or not filecmp.cmp(folders[1] / path, folders[threads] / path, shallow=False)
    ]
    return [
        Row(
            "`RAYON_NUM_THREADS` 1, 2, 7: byte-identical assets and index",
            f"{len(listed)} files, {len(different)} differ",
            not different and len(listed) > 0,
            ", ".join(different[:5]),
        )
    ]


def twins():
    """The runtime's shaders against the CPU twin on baked scenes."""
    out = bakes.worked()
    tool = example("twin")
    rows = []
    for scene in bakes.scene_names(bakes.manifest()):
        rows += rows_of(run([tool, out / scene]))
    return rows


def shared_scenes():
    """Large shared scenes: seconds, bytes, memory."""
    rows = []
    for name in ("pandora", "lost-empire"):
        asked = f"{name} by its shared manifest: bakes in {MEMORY >> 30} GiB or less"
        file = bakes.shared(name)
        if file is None:
            rows.append(Row(asked, "absent", None))
            continue
        seconds, peak, timings = bakes.measured_bake(file)
        out = file.parent / "out"
        index = json.loads((out / "index.json").read_text(encoding="utf-8"))
        total = sum(f["bytes"] for asset in index["assets"] for f in asset["files"])
        pictures = sorted(str(p.relative_to(TARGET)) for p in out.rglob("*.png"))
        rows.append(
            Row(
                asked,
                f"{seconds:.0f} s, assets {total / 1e6:.1f} MB, peak {peak / 2**20:.0f} MiB",
                peak <= MEMORY,
                f"{timings['rays'] / 1e6:.0f} million rays, {timings['threads']} threads; "
                f"{bakes.stages(timings, name)}; pictures below target/: {', '.join(pictures)}",
            )
        )
    return rows


LINES = [
    Line("clone", "bare clone, the README's two commands", clone, long=True),
    Line("leaks", "rays in closed rooms", lambda: figures("leaks")),
    Line("self-hits", "rays from a convex mesh", lambda: figures("self-hits")),
    Line("sphere", "integrating sphere", lambda: figures("sphere")),
    Line("room", "closed uniform room", lambda: figures("room")),
    Line("form-factors", "form factors of unit squares", lambda: figures("form-factors")),
    Line("reference", "PRM against the reference, 64 poses", compared),
    Line("replay", "gather time over replay time", replayed),
    Line("threads", "the same bytes with 1, 2, 7 threads", same_bytes),
    Line("readers", "assets read by others", readers.rows),
    Line("twin", "WGSL against the CPU twin", twins),
    Line("shared-scenes", "pandora and lost-empire", shared_scenes),
]
