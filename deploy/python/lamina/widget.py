"""A recorded step, or a run's steps one at a time, in a notebook: the viewer's `widget.js` is the other half."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import anywidget
import traitlets

from .notebook import viewer_file

if TYPE_CHECKING:
    from .notebook import View


class Turntable(anywidget.AnyWidget):
    """A picture that can be turned; of a run, with a slider of its steps."""

    engine = traitlets.Bytes().tag(sync=True)
    encoded = traitlets.Bytes().tag(sync=True)
    title = traitlets.Unicode().tag(sync=True)
    size = traitlets.Int().tag(sync=True)
    steps = traitlets.List(traitlets.Int()).tag(sync=True)
    step = traitlets.Int().tag(sync=True)
    pose = traitlets.Dict().tag(sync=True)

    def __init__(self, view: View) -> None:
        self._run = view.run
        steps = view.run.steps if view.run else [0]
        super().__init__(
            _esm=viewer_file("widget.js").decode(),
            engine=viewer_file("engine.wasm.gz"),
            encoded=view.encoded,
            title=view.title,
            size=view.size,
            steps=steps,
            step=steps[-1],
            pose={"azimuth": 0.0, "elevation": 0.0, "zoom": 1.0},
        )
        self.observe(self._show, "step")

    @traitlets.validate("step")
    def _known(self, proposal: Any) -> int:
        if proposal["value"] not in self.steps:
            raise traitlets.TraitError(f"step {proposal['value']} was not recorded; {len(self.steps)} others were")
        return proposal["value"]

    def _show(self, change: Any) -> None:
        if self._run is not None:
            self.encoded = self._run[change["new"]].encoded
