"""Baked assets as programs that are not ours read them."""

import json

from .bakes import worked
from .line import Row
from .tools import ROOT, debian, npm_folder, python_with, run

CHECK_ARRAYS = """
import sys, numpy
from safetensors import safe_open
arrays = 0
for path in sys.argv[1:]:
    with safe_open(path, framework="np") as file:
        for name in file.keys():
            array = file.get_tensor(name)
            assert list(array.shape) == file.get_slice(name).get_shape(), (path, name)
            if array.dtype.kind == "f":
                assert numpy.isfinite(array).all(), (path, name, "is not finite")
            arrays += 1
print(arrays)
"""

CHECK_INDEX = """
import json, sys, jsonschema
schema, index = (json.load(open(path)) for path in sys.argv[1:])
jsonschema.Draft202012Validator.check_schema(schema)
errors = list(jsonschema.Draft202012Validator(schema).iter_errors(index))
print(len(errors), *[e.message for e in errors[:3]])
"""

CHECK_GLTF = """
const validator = require("gltf-validator");
const fs = require("fs");
(async () => {
  const counts = [];
  for (const path of process.argv.slice(1)) {
    const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(path)));
    const { issues } = report;
    counts.push({ path, errors: issues.numErrors, warnings: issues.numWarnings,
      messages: issues.messages.filter((m) => m.severity < 2).slice(0, 3).map((m) => m.message) });
  }
  console.log(JSON.stringify(counts));
})();
"""


def files(out, suffix):
    """Files of the index that end in `suffix`."""
    index = json.loads((out / "index.json").read_text(encoding="utf-8"))
    return [
        out / file["path"]
        for asset in index["assets"]
        for file in asset["files"]
        if file["path"].endswith(suffix)
    ]


def rows():
    out = worked()
    exrs, maps, scenes = (files(out, s) for s in (".exr", ".safetensors", ".glb"))
    tool = debian("exrheader", "openexr")
    for exr in exrs:
        run([tool, exr])
    python = python_with("numpy", "safetensors", "jsonschema")
    arrays = int(run([python, "-c", CHECK_ARRAYS, *maps]))
    schema = ROOT / "format" / "schema" / "index.schema.json"
    problems = run([python, "-c", CHECK_INDEX, schema, out / "index.json"]).strip()
    node = run(["node", "-e", CHECK_GLTF, *scenes], cwd=npm_folder("gltf-validator"))
    reports = json.loads(node)
    errors = sum(r["errors"] for r in reports)
    warnings = sum(r["warnings"] for r in reports)
    messages = "; ".join(m for r in reports for m in r["messages"])
    return [
        Row("`exrheader` accepts every EXR", f"{len(exrs)} accepted", len(exrs) > 0),
        Row(
            "Python's `safetensors` opens every array, all finite",
            f"{arrays} arrays of {len(maps)} files",
            arrays > 0,
        ),
        Row(
            "`index.json` validates against its schema",
            "0 errors" if problems == "0" else problems,
            problems == "0",
        ),
        Row(
            "`gltf-validator` finds no error in `scene.lit.glb`",
            f"{errors} errors, {warnings} warnings in {len(reports)} files",
            errors == 0 and bool(reports),
            messages,
        ),
    ]
