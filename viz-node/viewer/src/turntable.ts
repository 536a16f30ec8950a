// One step that can be turned, without a server: engine and step are at hand. WebGL2 draws, which browsers give to files too, or the processor.

import { DraftSize } from "./draft_size";
import type { Renderer } from "./engine/renderer";
import { type Description, type Engine, FRONT, type Pose } from "./engine/wasm";

const STILL_AFTER_MS = 150;
const LARGEST_SIZE = 768;

export const unpacked = async (packed: Uint8Array<ArrayBuffer>): Promise<ArrayBuffer> =>
  new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();

export class Turntable {
  private pose: Pose = FRONT;
  private step: { handle: number; description: Description } | null = null;
  private readonly draft = new DraftSize();
  private timer = 0;
  private frame = 0;
  /** Counts pictures begun: a still gives way to whatever comes after it. */
  private drawn = 0;

  /** `moved` is told where it is seen from, whenever that rests. */
  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly engine: Engine,
    private readonly gpu: Renderer | null,
    private readonly moved: (pose: Pose) => void = () => undefined,
  ) {
    this.listen();
  }

  /** Shows a recorded step in place of the one before. */
  show(encoded: Uint8Array): void {
    const before = this.step;
    this.step = this.engine.open(encoded);
    if (before) {
      this.gpu?.forget(before.handle);
      this.engine.close(before.handle);
    }
    this.move(this.pose);
  }

  move(pose: Pose): void {
    const { azimuth, elevation, zoom } = pose;
    this.pose = { ...pose, azimuth, elevation: Math.min(Math.max(elevation, -89), 89), zoom: Math.min(Math.max(zoom, 0.25), 8) };
    // One draft at a time: else each would give way to the next in motion, and none be seen.
    this.frame ||= requestAnimationFrame(() => void this.draw(this.draft.side, false).finally(() => (this.frame = 0)));
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.moved(this.pose);
      // Of a canvas that is not laid out the width is 0.
      const side = Math.min(Math.round((this.canvas.clientWidth || LARGEST_SIZE) * devicePixelRatio), LARGEST_SIZE);
      void this.draw(side, true);
    }, STILL_AFTER_MS);
  }

  private async draw(side: number, still: boolean): Promise<void> {
    const picture = ++this.drawn;
    const begun = performance.now();
    const wanted = () => picture === this.drawn;
    const byGpu = await this.onGpu(side, still, wanted);
    const bitmap = byGpu ?? (wanted() ? await this.onProcessor(side, still, wanted) : null);
    if (!bitmap) return;
    [this.canvas.width, this.canvas.height] = [side, side];
    this.canvas.getContext("2d")!.drawImage(bitmap, 0, 0);
    bitmap.close();
    Object.assign(this.canvas.dataset, { still, azimuth: this.pose.azimuth, drawnBy: byGpu ? "gpu" : "cpu" });
    if (!still) this.draft.record(side, performance.now() - begun);
  }

  /** Null where there is no GPU that can, or the picture is no longer wanted. */
  private async onGpu(side: number, still: boolean, wanted: () => boolean): Promise<ImageBitmap | null> {
    const { gpu, step, pose } = this;
    if (!gpu || !step || gpu.lost !== null || !step.description.visible) return null;
    const { handle, description } = step;
    try {
      const ready = gpu.ready(handle, description, () => this.move(this.pose));
      return ready ? await gpu.draw(handle, pose, side, still, wanted) : null;
    } catch {
      // The processor draws what the device failed at.
      return null;
    }
  }

  private async onProcessor(side: number, still: boolean, wanted: () => boolean): Promise<ImageBitmap | null> {
    if (!this.step) return null;
    this.engine.begin(this.step.handle, this.pose, side, side, still);
    for (;;) {
      const pixels = this.engine.advance();
      if (pixels) return createImageBitmap(new ImageData(pixels, side, side));
      await new Promise((resolve) => setTimeout(resolve));
      if (!wanted()) return null;
    }
  }

  private listen(): void {
    const { canvas } = this;
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons === 0) return;
      const scale = 180 / canvas.clientWidth;
      const { azimuth, elevation } = this.pose;
      this.move({ ...this.pose, azimuth: azimuth - event.movementX * scale, elevation: elevation + event.movementY * scale });
    });
    canvas.addEventListener("dblclick", () => this.move(FRONT));
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.move({ ...this.pose, zoom: this.pose.zoom * Math.exp(-event.deltaY * 0.0015) });
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (event) => {
      const turns: Record<string, [number, number]> = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] };
      const turn = turns[event.key];
      if (!turn) return;
      event.preventDefault();
      this.move({ ...this.pose, azimuth: this.pose.azimuth + turn[0], elevation: this.pose.elevation + turn[1] });
    });
  }
}
