"""Builds the programs and libraries that the wheel brings, and names the oldest system it runs on."""

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).resolve().parents[2]
NATIVES = ["lamina", "generator-node", "viz-node", "tuner", "liblamina_c.so", "liblamina_python.so"]
VIEWER = ["embed.js", "widget.js", "engine.wasm.gz"]


def newest_glibc(files):
    """The newest version of the C library's symbols that the files ask for."""
    versions = set()
    for file in files:
        versions |= {tuple(map(int, found)) for found in re.findall(rb"GLIBC_(\d+)\.(\d+)", file.read_bytes())}
    return max(versions)


class Build(BuildHookInterface):
    """Called by hatchling for each wheel."""

    def initialize(self, version, build_data):
        if not (sys.platform == "linux" and (ROOT / "Cargo.toml").exists()):
            raise RuntimeError("the wheel is built on Linux, in the source tree")
        built = os.environ.get("LAMINA_BIN") or Path(os.environ.get("CARGO_TARGET_DIR", "target")) / "release"
        target = ROOT / built
        if "LAMINA_BIN" not in os.environ:
            # Together, so that the workspace's features and target folder serve again.
            subprocess.run(["cargo", "build", "--workspace", "--release", "--locked"], cwd=ROOT, check=True)
        natives = [target / name for name in NATIVES]
        major, minor = newest_glibc(natives)
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-manylinux_{major}_{minor}_{platform.machine()}"
        viewer = [ROOT / "viz-node/viewer/dist" / name for name in VIEWER]
        for file in natives + viewer:
            build_data["force_include"][str(file)] = f"lamina/native/{file.name}"
        # By the name that Catalyst looks for.
        build_data["force_include"][str(target / "libcatalyst_lamina.so")] = "lamina/native/libcatalyst-lamina.so"
