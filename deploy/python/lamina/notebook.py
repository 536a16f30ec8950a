"""A recorded step or a volume that can be turned, in a notebook or in a file of its own."""

from __future__ import annotations

import base64
import html
import os
import subprocess
import tempfile
from pathlib import Path

from .installed import INSTALLED, program
from .reader import Reduced, Run, Vdi, Volume, read

# Points a side that a volume is reduced to for being shown, and the part of its range that a value may be off by.
_SIDE, _ERROR = 96, 0.005

_PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>
<style>body {{ margin: 0; font: 13px sans-serif }} canvas {{ width: min(100vw, 100vh - 2em); aspect-ratio: 1; touch-action: none }}</style>
<canvas id="turntable" width="{size}" height="{size}" tabindex="0" role="img" aria-label="{title}, which can be turned"></canvas>
<div>{title}: drag or arrow keys turn it, the wheel zooms, a double click goes back</div>
<script type="application/octet-stream" id="lamina-engine">{engine}</script>
<script type="application/octet-stream" id="lamina-step">{step}</script>
<script>{script}</script></html>
"""


class View:
    """What `view` gives: a notebook shows it; `html` is a document, `save` writes it."""

    def __init__(self, encoded: bytes, title: str, size: int) -> None:
        folder = Path(os.environ.get("LAMINA_VIEWER") or INSTALLED)
        try:
            script, engine = (folder / "embed.js").read_text(), (folder / "engine.wasm.gz").read_bytes()
        except OSError as error:
            raise OSError(f"{error}; name the folder of the built viewer in LAMINA_VIEWER, such as viz-node/viewer/dist") from None
        inside = {"engine": base64.b64encode(engine).decode(), "step": base64.b64encode(encoded).decode(), "script": script}
        self.size = size
        self.html = _PAGE.format(title=html.escape(title, quote=True), size=size, **inside)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the document; it needs nothing else, and no network."""
        Path(path).write_text(self.html)

    def _repr_html_(self) -> str:
        # A frame of its own: two views do not meet.
        inside = html.escape(self.html, quote=True)
        return f'<iframe sandbox="allow-scripts" width="{self.size}" height="{self.size + 40}" style="border: 0" srcdoc="{inside}"></iframe>'


def view(shown: Vdi | Reduced | Volume | Run | str | os.PathLike[str], size: int = 512) -> View:
    """A picture of `size` pixels that can be turned, drawn where it is shown: of what `read` gave, or of a file that it reads. Of a run the
    last step; a volume file is sent as a reduced volume."""
    if not isinstance(shown, (Vdi, Reduced, Volume, Run)):
        shown = read(shown)
    if isinstance(shown, Run):
        shown = shown[shown.steps[-1]]
    if not isinstance(shown, Volume):
        return View(shown.path.read_bytes(), shown.path.name, size)
    with tempfile.TemporaryDirectory() as folder:
        reduced = Path(folder) / "step.lvol"
        options = ["--representation", "volume", "--resolution", str(_SIDE), "--gamma", str(_ERROR), "--out", str(reduced)]
        command = [program("lamina"), "generate", *shown.as_options(), *options]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise ValueError(done.stderr.strip())
        return View(reduced.read_bytes(), f"{shown.path.name} ({shown.field})", size)
