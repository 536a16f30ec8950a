// The decoder, the data of the kernels and the processor's renderer: `engine/` compiled to WebAssembly, called by plain numbers.

import type { Vector } from "../vector";

/** A camera relative to the recorded one: angles in degrees, the distance divided by `zoom`, shifts of eye and target in heights of the picture. */
export interface Pose {
  azimuth: number;
  elevation: number;
  zoom: number;
  right: number;
  up: number;
  ahead: number;
  roll: number;
}

export const FRONT: Pose = { azimuth: 0, elevation: 0, zoom: 1, right: 0, up: 0, ahead: 0, roll: 0 };

export interface ControlPoint {
  at: number;
  color: Vector;
  opacity: number;
}

/** The camera of the scene. */
export interface RecordedCamera {
  position: Vector;
  target: Vector;
  up: Vector;
  fov_y_deg: number;
}

/** The scalars shown, and what they look like. */
export interface TransferFunction {
  range: { lo: number; hi: number; scale: "linear" | "log10" };
  points: ControlPoint[];
}

export interface Isosurface {
  value: number;
  color: Vector;
  opacity: number;
}

export interface ClipBox {
  min: Vector;
  max: Vector;
}

/** What a scene asks for beyond emission and absorption: the keys of a scene file. */
export interface Effects {
  light?: Vector;
  shading?: { ambient: number; diffuse: number; specular: number; shininess: number };
  shadows?: number;
  ambient_occlusion?: number;
  isosurfaces?: Isosurface[];
  clip_planes?: object[];
  clip_box?: ClipBox;
  pre_integrated?: boolean;
  depth_cue?: object;
}

export interface Description {
  representation: "vdi" | "volume";
  camera: RecordedCamera;
  /** Of a volume. */
  transfer: TransferFunction | null;
  /** Of a volume. */
  effects: Effects | null;
  /** Parts of the range whose values were not recorded. */
  unrecorded: [number, number][];
  /** How many points of a volume lie in each of 64 equal parts of the range. */
  histogram: number[];
  bounds: [Vector, Vector];
  elements: number;
  constants: [string, number][];
  background: Vector;
  /** False if no picture shows anything but the background. */
  visible: boolean;
}

/** A resource of a kernel. */
export interface Resource {
  group: number;
  binding: number;
  kind: "uniform" | "storage" | "texture";
  format: GPUTextureFormat | null;
  dims: [number, number, number] | null;
  bytes: Uint8Array<ArrayBuffer>;
}

/** Values of a volume on a plane, rows upwards: positions in the range, NaN where there is none. */
export interface Slice {
  width: number;
  height: number;
  units: Float32Array<ArrayBuffer>;
}

interface Exports {
  memory: WebAssembly.Memory;
  lamina_room(length: number): number;
  lamina_answer(): number;
  lamina_answer_length(): number;
  lamina_open(start: number, length: number, maxDecodedBytes: number): number;
  lamina_band_sizes(start: number, length: number, maxDecodedBytes: number): number;
  lamina_begin_geometry(start: number, length: number, band: number, maxDecodedBytes: number): number;
  lamina_geometry(): number;
  lamina_begin_colors(start: number, length: number, band: number, maxDecodedBytes: number): number;
  lamina_color(start: number, length: number): number;
  lamina_end_colors(): number;
  lamina_join(start: number, length: number, whole: number, maxDecodedBytes: number): number;
  lamina_with_appearance(handle: number, start: number, length: number): number;
  lamina_close(handle: number): void;
  lamina_bindings(handle: number): number;
  lamina_view(handle: number, ...numbers: number[]): number;
  lamina_slice(handle: number, axis: number, at: number): number;
  lamina_begin(handle: number, ...numbers: number[]): number;
  lamina_advance(): number;
  lamina_source(volume: number): number;
}

/** The most that a decoded step may take, bytes: what a tab can be asked for. */
export const MAX_DECODED_BYTES = 1 << 29;

const numbers = (pose: Pose) => [pose.azimuth, pose.elevation, pose.zoom, pose.right, pose.up, pose.ahead, pose.roll];

export class Engine {
  private constructor(
    private readonly wasm: Exports,
    readonly module: WebAssembly.Module,
  ) {}

  static async load(url: string | URL): Promise<Engine> {
    return Engine.of(await WebAssembly.compileStreaming(fetch(url)));
  }

  /** Another instance of the same module, or the first of one. */
  static async of(module: WebAssembly.Module): Promise<Engine> {
    const { exports } = await WebAssembly.instantiate(module, {});
    return new Engine(exports as unknown as Exports, module);
  }

  /** Decodes a recorded step. */
  open(bytes: Uint8Array): { handle: number; description: Description } {
    const handle = this.checked(this.wasm.lamina_open(this.fill(bytes), bytes.length, MAX_DECODED_BYTES));
    return { handle, description: this.json() as Description };
  }

  /** The bytes of each band whose geometry and colors can be decoded apart; none if there are none. */
  bandSizes(bytes: Uint8Array): number[] {
    this.checked(this.wasm.lamina_band_sizes(this.fill(bytes), bytes.length, MAX_DECODED_BYTES));
    return this.json() as number[];
  }

  /** Begins to decode the geometry of a band. */
  beginGeometry(bytes: Uint8Array, band: number): void {
    this.checked(this.wasm.lamina_begin_geometry(this.fill(bytes), bytes.length, band, MAX_DECODED_BYTES));
  }

  /** The next slice of it; null behind the last. */
  geometry(): Uint8Array<ArrayBuffer> | null {
    this.checked(this.wasm.lamina_geometry());
    const slice = this.raw();
    return slice.length === 0 ? null : slice.slice();
  }

  /** Begins to decode the colors of a band. */
  beginColors(bytes: Uint8Array, band: number): void {
    this.checked(this.wasm.lamina_begin_colors(this.fill(bytes), bytes.length, band, MAX_DECODED_BYTES));
  }

  /** Decodes those of a slice. */
  color(slice: Uint8Array): void {
    this.checked(this.wasm.lamina_color(this.fill(slice), slice.length));
  }

  /** The band, for `join`. */
  endColors(): Uint8Array<ArrayBuffer> {
    this.checked(this.wasm.lamina_end_colors());
    return this.raw().slice();
  }

  /** The recorded step that `bands` were decoded from, all of them in order. */
  join(bytes: Uint8Array, bands: Uint8Array[]): { handle: number; description: Description } {
    const whole = bands.reduce((sum, band) => sum + band.length, bytes.length);
    const start = this.fill(bytes, ...bands);
    const handle = this.checked(this.wasm.lamina_join(start, bytes.length, whole, MAX_DECODED_BYTES));
    return { handle, description: this.json() as Description };
  }

  /** The volume `handle` with another appearance: JSON of control points and effects. */
  withAppearance(handle: number, appearance: string): { handle: number; description: Description } {
    const bytes = new TextEncoder().encode(appearance);
    const changed = this.checked(this.wasm.lamina_with_appearance(handle, this.fill(bytes), bytes.length));
    return { handle: changed, description: this.json() as Description };
  }

  close(handle: number): void {
    this.wasm.lamina_close(handle);
  }

  /** WGSL with the entry point `color_rows`. */
  source(representation: Description["representation"]): string {
    this.checked(this.wasm.lamina_source(representation === "vdi" ? 0 : 1));
    return this.json() as string;
  }

  /** What the kernel reads, whatever the camera. */
  bindings(handle: number): Resource[] {
    this.checked(this.wasm.lamina_bindings(handle));
    return this.resources();
  }

  /** What the kernel reads for some rows, `count` from `first` on, of a picture. */
  view(handle: number, pose: Pose, side: number, still: boolean, [first, count]: [number, number]): Resource[] {
    this.checked(this.wasm.lamina_view(handle, ...numbers(pose), side, side, Number(still), first, count));
    return this.resources();
  }

  /** The plane across `axis` at `at`, 0 to 1, of a volume. */
  slice(handle: number, axis: number, at: number): Slice {
    this.checked(this.wasm.lamina_slice(handle, axis, at));
    const { json, content } = this.answer();
    const [width, height] = json as [number, number];
    return { width, height, units: new Float32Array(content.slice(0, 4 * width * height).buffer) };
  }

  /** Begins a picture that the processor draws. */
  begin(handle: number, pose: Pose, width: number, height: number, still: boolean): void {
    this.checked(this.wasm.lamina_begin(handle, ...numbers(pose), width, height, Number(still)));
  }

  /** Draws the next part of it; red, green, blue and 255 per pixel once it is whole. */
  advance(): Uint8ClampedArray<ArrayBuffer> | null {
    this.checked(this.wasm.lamina_advance());
    if (this.wasm.lamina_answer_length() === 0) return null;
    const { content } = this.answer();
    return new Uint8ClampedArray(content);
  }

  private fill(...parts: Uint8Array[]): number {
    const start = this.wasm.lamina_room(parts.reduce((sum, part) => sum + part.length, 0));
    let next = start;
    for (const part of parts) {
      new Uint8Array(this.wasm.memory.buffer, next, part.length).set(part);
      next += part.length;
    }
    return start;
  }

  private raw(): Uint8Array<ArrayBuffer> {
    return new Uint8Array(this.wasm.memory.buffer as ArrayBuffer, this.wasm.lamina_answer(), this.wasm.lamina_answer_length());
  }

  private checked(code: number): number {
    if (code < 0) throw new Error(new TextDecoder().decode(this.raw()));
    return code;
  }

  private answer(): { json: unknown; content: Uint8Array } {
    const raw = this.raw();
    const length = new DataView(raw.buffer, raw.byteOffset).getUint32(0, true);
    const json: unknown = JSON.parse(new TextDecoder().decode(raw.subarray(4, 4 + length)));
    return { json, content: raw.subarray(Math.ceil((4 + length) / 16) * 16) };
  }

  private json(): unknown {
    return this.answer().json;
  }

  private resources(): Resource[] {
    const { json, content } = this.answer();
    const entries = json as (Omit<Resource, "bytes"> & { offset: number; length: number })[];
    return entries.map(({ offset, length, ...entry }) => ({ ...entry, bytes: content.slice(offset, offset + length) }));
  }
}
