// The worker that decodes and draws, so that the page never waits.

import { BAND_WORKER, BandDecoder, serveBands } from "./bands";
import type { Device, Reply, Request } from "./protocol";
import type { Renderer } from "./renderer";
import { type Description, Engine } from "./wasm";
import { WebGl } from "./webgl";
import { WebGpu } from "./webgpu";

type Draw = Extract<Request, { kind: "draw" }>;

interface Held {
  handle: number;
  description: Description;
  /** The same volume looking otherwise, as last asked for. */
  changed: { appearance: string; handle: number; description: Description } | null;
}

const reply = (message: Reply, transfer: Transferable[] = []) => postMessage(message, { transfer });

const reason = (error: unknown) => (error instanceof Error ? error.message : String(error));

/** Lets messages in between two parts of a picture. */
const breath = () =>
  new Promise<void>((resolve) => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => {
      port1.close();
      resolve();
    };
    port2.postMessage(null);
  });

class Painter {
  private readonly held = new Map<string, Held>();
  private readonly opening = new Set<string>();
  private readonly bands: BandDecoder;
  private next: Draw | null = null;
  private current: Draw | null = null;

  constructor(
    private readonly engine: Engine,
    private gpu: Renderer | null,
  ) {
    this.bands = new BandDecoder(engine);
  }

  device(): Device {
    if (this.gpu) return { kind: "gpu", api: this.gpu.api, name: this.gpu.name };
    return { kind: "cpu", why: "neither WebGPU nor WebGL2 has a GPU here" };
  }

  async open(key: string, bytes: Uint8Array<ArrayBuffer>): Promise<void> {
    const begun = performance.now();
    this.opening.add(key);
    try {
      const { handle, description, decoders } = await this.decoded(bytes);
      if (!this.opening.delete(key)) {
        this.forget(handle);
        throw new Error("the step is no longer wanted");
      }
      this.close(key);
      this.held.set(key, { handle, description, changed: null });
      reply({ kind: "opened", key, decodeMs: performance.now() - begun, decoders, description });
    } catch (error) {
      this.opening.delete(key);
      reply({ kind: "refused", key, reason: reason(error) });
    }
  }

  private async decoded(bytes: Uint8Array<ArrayBuffer>): Promise<{ handle: number; description: Description; decoders: number }> {
    const sizes = this.engine.bandSizes(bytes);
    const apart = await this.bands.decode(bytes, sizes).catch(() => null);
    // What the bands' workers fail at fails here too, and it is said why.
    return apart ? { ...this.engine.join(bytes, apart.bands), decoders: apart.workers } : { ...this.engine.open(bytes), decoders: 1 };
  }

  close(key: string): void {
    this.opening.delete(key);
    const held = this.held.get(key);
    if (!held) return;
    this.held.delete(key);
    this.forget(held.handle);
    if (held.changed) this.forget(held.changed.handle);
  }

  private forget(handle: number): void {
    this.gpu?.forget(handle);
    this.engine.close(handle);
  }

  slice({ id, key, axis, at }: Extract<Request, { kind: "slice" }>): void {
    const held = this.held.get(key);
    try {
      if (!held) throw new Error("the step is no longer held");
      const slice = this.engine.slice(held.handle, axis, at);
      reply({ kind: "sliced", id, slice }, [slice.units.buffer]);
    } catch (error) {
      reply({ kind: "failed", id, reason: reason(error) });
    }
  }

  cancel(id: number): void {
    if (this.next?.id === id) this.next = null;
    else if (this.current?.id === id) this.current = null;
    else return;
    reply({ kind: "dropped", id });
  }

  /** Draws the newest request; older ones are dropped. */
  async draw(request: Draw): Promise<void> {
    if (this.next) reply({ kind: "dropped", id: this.next.id });
    this.next = request;
    if (this.busy) return;
    this.busy = true;
    while (this.next) {
      const request: Draw = this.next;
      [this.current, this.next] = [request, null];
      try {
        await this.paint(request);
      } catch (error) {
        if (this.gpu && this.gpu.lost !== null) {
          // The processor draws the picture that the device failed at, unless a newer one is asked for.
          this.withoutGpu();
          if (this.next) reply({ kind: "dropped", id: request.id });
          else this.next = request;
        } else reply({ kind: "failed", id: request.id, reason: reason(error) });
      }
    }
    this.busy = false;
  }
  private busy = false;

  /** Goes on by the processor. */
  private withoutGpu(): void {
    reply({ kind: "device", device: { kind: "cpu", why: `the GPU failed: ${this.gpu?.lost}` } });
    this.gpu = null;
  }

  private shown(held: Held, appearance: string | null): { handle: number; description: Description } {
    if (appearance === null || held.description.representation === "vdi") return held;
    if (held.changed?.appearance === appearance) return held.changed;
    const { handle, description } = this.engine.withAppearance(held.handle, appearance);
    if (held.changed) this.forget(held.changed.handle);
    held.changed = { appearance, handle, description };
    return held.changed;
  }

  private async paint(request: Draw): Promise<void> {
    const { id, key, pose, side, still, appearance } = request;
    const held = this.held.get(key);
    if (!held) return reply({ kind: "failed", id, reason: "the step is no longer held" });
    const begun = performance.now();
    const { handle, description } = this.shown(held, appearance);
    const wanted = () => this.current === request && this.next === null && this.held.get(key) === held;
    // The processor draws while the kernel is compiled; then the page may ask again.
    const compiled = () => reply({ kind: "device", device: this.device() });
    if (this.gpu && this.gpu.lost !== null) this.withoutGpu();
    const byGpu = this.gpu !== null && description.visible && this.gpu.ready(handle, description, compiled);
    const bitmap = !description.visible
      ? background(description, side)
      : this.gpu && byGpu
        ? await this.gpu.draw(handle, pose, side, still, wanted)
        : await this.onProcessor(handle, request, wanted);
    if (this.current !== request) return bitmap?.close();
    this.current = null;
    const [drawMs, by] = [performance.now() - begun, byGpu ? ("gpu" as const) : ("cpu" as const)];
    if (bitmap) reply({ kind: "drawn", id, bitmap, drawMs, by }, [bitmap]);
    else reply({ kind: "dropped", id });
  }

  private async onProcessor(handle: number, { pose, side, still }: Draw, wanted: () => boolean): Promise<ImageBitmap | null> {
    this.engine.begin(handle, pose, side, side, still);
    for (;;) {
      const pixels = this.engine.advance();
      if (pixels) return createImageBitmap(new ImageData(pixels, side, side));
      await breath();
      if (!wanted()) return null;
    }
  }
}

function background({ background: [red, green, blue] }: Description, side: number): ImageBitmap {
  const canvas = new OffscreenCanvas(side, side);
  const context = canvas.getContext("2d")!;
  context.fillStyle = `rgb(${[red, green, blue].map((c) => Math.round(255 * c)).join(" ")})`;
  context.fillRect(0, 0, side, side);
  return canvas.transferToImageBitmap();
}

/** Browsers give WebGPU to pages of https and of localhost only, and many have none. */
async function device(engine: Engine): Promise<Renderer | null> {
  // The worker's name is what should draw, where somebody asked; then software will do.
  const asked = self.name;
  if (asked === "cpu") return null;
  const webGpu = asked === "webgl" ? null : await WebGpu.open(engine, asked === "webgpu");
  return webGpu ?? (asked === "webgpu" ? null : WebGl.open(engine, asked === "webgl"));
}

const early: Request[] = [];
let painter: Painter | null = null;

function take(request: Request): void {
  if (!painter) early.push(request);
  else if (request.kind === "open") void painter.open(request.key, new Uint8Array(request.bytes));
  else if (request.kind === "close") painter.close(request.key);
  else if (request.kind === "cancel") painter.cancel(request.id);
  else if (request.kind === "slice") painter.slice(request);
  else void painter.draw(request);
}

async function servePictures(): Promise<void> {
  onmessage = ({ data }: MessageEvent<Request>) => take(data);
  const engine = await Engine.load("engine.wasm");
  painter = new Painter(engine, await device(engine));
  reply({ kind: "ready", device: painter.device() });
  early.splice(0).forEach(take);
}

if (self.name === BAND_WORKER) serveBands();
else await servePictures();
