"""A recorded step or a volume that can be turned, in a notebook or in a file of its own."""

from __future__ import annotations

import base64
import functools
import html
import os
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .installed import INSTALLED, program
from .reader import Reduced, Run, Vdi, Volume, read

if TYPE_CHECKING:
    from .widget import Turntable

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


def viewer_file(name: str) -> bytes:
    """A file of the built viewer."""
    folder = Path(os.environ.get("LAMINA_VIEWER") or INSTALLED)
    try:
        return (folder / name).read_bytes()
    except OSError as error:
        raise OSError(f"{error}; name the folder of the built viewer in LAMINA_VIEWER, such as viz-node/viewer/dist") from None


class View:
    """What `view` gives: a notebook shows it; `html` is a document, `save` writes it. Where anywidget is installed (`lamina-insitu[jupyter]`),
    a notebook shows `widget`, which has a slider of a run's steps."""

    def __init__(self, encoded: bytes, title: str, size: int, run: Run | None = None) -> None:
        self.encoded, self.title, self.size, self.run = encoded, title, size, run

    @property
    def html(self) -> str:
        """One step in a document that needs nothing else."""
        script, engine = viewer_file("embed.js").decode(), viewer_file("engine.wasm.gz")
        inside = {"engine": base64.b64encode(engine).decode(), "step": base64.b64encode(self.encoded).decode(), "script": script}
        return _PAGE.format(title=html.escape(self.title, quote=True), size=self.size, **inside)

    @functools.cached_property
    def widget(self) -> Turntable:
        """Its traits can be read, set and observed: `step`, and `pose` (azimuth, elevation: degrees; zoom). Needs anywidget."""
        from .widget import Turntable

        return Turntable(self)

    def _repr_mimebundle_(self, **options: Any) -> Any:
        try:
            return self.widget._repr_mimebundle_(**options)
        except ImportError:
            return {"text/html": self._repr_html_(), "text/plain": self.title}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the document; it needs nothing else, and no network."""
        Path(path).write_text(self.html)

    def _repr_html_(self) -> str:
        # A frame of its own: two views do not meet.
        inside = html.escape(self.html, quote=True)
        return f'<iframe sandbox="allow-scripts" width="{self.size}" height="{self.size + 40}" style="border: 0" srcdoc="{inside}"></iframe>'


def view(shown: Vdi | Reduced | Volume | Run | str | os.PathLike[str], size: int = 512) -> View:
    """A picture of `size` pixels that can be turned, drawn where it is shown: of what `read` gave, or of a file that it reads. Of a run the
    last step, and in a notebook with anywidget any of them; a volume file is sent as a reduced volume."""
    if not isinstance(shown, (Vdi, Reduced, Volume, Run)):
        shown = read(shown)
    if isinstance(shown, Run):
        return View(shown[shown.steps[-1]].encoded, shown.path.name, size, shown)
    if not isinstance(shown, Volume):
        return View(shown.encoded, shown.path.name, size)
    with tempfile.TemporaryDirectory() as folder:
        reduced = Path(folder) / "step.lvol"
        options = ["--representation", "volume", "--resolution", str(_SIDE), "--gamma", str(_ERROR), "--out", str(reduced)]
        command = [program("lamina"), "generate", *shown.as_options(), *options]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise ValueError(done.stderr.strip())
        return View(reduced.read_bytes(), f"{shown.path.name} ({shown.field})", size)
