"""Baked scenes that several lines read."""

import json
import os
import subprocess
import time

from .tools import ROOT, WORK, baker, relocated, run, scenes_folder

#: The worked manifest, and the scenes of it that figures are promised for.
MANIFEST = ROOT / "pipeline.toml"
SCENES = ("box", "chamber")


def manifest():
    """The worked manifest with its output below target/."""
    return relocated(MANIFEST, WORK / "worked")


def shared(name):
    """A shared scene's manifest with its output below target/, or None where they are absent."""
    folder = scenes_folder()
    if folder is None:
        return None
    return relocated(folder / "manifests" / f"{name}.toml", WORK / name)


def scene_names(file):
    """Names of the scenes of a manifest."""
    plan = json.loads(run([baker(), "plan", "--manifest", file, "--format", "json"]))
    return list(dict.fromkeys(job["scene"] for job in plan))


def worked():
    """Output folder of the worked manifest, baked by the command as it is now."""
    file, tool = manifest(), baker()
    out = file.parent / "out"
    index = out / "index.json"
    newest = max(tool.stat().st_mtime, MANIFEST.stat().st_mtime)
    if not index.exists() or index.stat().st_mtime < newest:
        run([tool, "bake", "--manifest", file])
    return out


def measured_bake(file, threads=None):
    """Bakes; returns wall seconds, peak resident bytes and timings.json."""
    environment = dict(os.environ)
    if threads:
        environment["RAYON_NUM_THREADS"] = str(threads)
    log = file.parent / "bake.log"
    started = time.monotonic()
    with open(log, "wb") as messages:
        child = subprocess.Popen(
            [str(baker()), "bake", "--manifest", str(file)],
            stdout=messages,
            stderr=subprocess.STDOUT,
            env=environment,
        )
        # wait4 tells what this child alone used; ru_maxrss is KiB on Linux.
        _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(f"bake of {file}: {log.read_text(errors='replace')[-400:]}")
    seconds = time.monotonic() - started
    timings = json.loads((file.parent / "out" / "timings.json").read_text(encoding="utf-8"))
    return seconds, usage.ru_maxrss * 1024, timings


def stages(timings, scene):
    """Seconds of each stage of one scene, in words."""
    took = {}
    for stage in timings["stages"]:
        if stage["scene"] == scene:
            took[stage["stage"]] = took.get(stage["stage"], 0) + stage["seconds"]
    return ", ".join(f"{name} {seconds:.2f} s" for name, seconds in took.items())
