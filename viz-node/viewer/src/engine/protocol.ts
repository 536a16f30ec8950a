// What the page and its worker tell each other.

import type { Description, Pose, Slice } from "./wasm";

/** What draws. */
export type Device = { kind: "gpu"; api: "WebGPU" | "WebGL2"; name: string } | { kind: "cpu"; why: string };

export type Request =
  /** Decode `bytes` and hold them as `key`. */
  | { kind: "open"; key: string; bytes: ArrayBuffer }
  | { kind: "close"; key: string }
  /** Takes the place of a picture asked for before. `appearance`: JSON, for a volume that looks otherwise than recorded. */
  | { kind: "draw"; id: number; key: string; pose: Pose; side: number; still: boolean; appearance: string | null }
  | { kind: "cancel"; id: number }
  /** The plane across an axis, at 0 to 1 along it, of a volume that is held. */
  | { kind: "slice"; id: number; key: string; axis: number; at: number };

export type Reply =
  | { kind: "ready"; device: Device }
  /** `decoders`: how many workers decoded it. */
  | { kind: "opened"; key: string; decodeMs: number; decoders: number; description: Description }
  | { kind: "refused"; key: string; reason: string }
  | { kind: "drawn"; id: number; bitmap: ImageBitmap; drawMs: number; by: "gpu" | "cpu" }
  | { kind: "sliced"; id: number; slice: Slice }
  /** Another picture took its place. */
  | { kind: "dropped"; id: number }
  | { kind: "failed"; id: number; reason: string }
  /** The device changed: a GPU was lost, or is ready now. */
  | { kind: "device"; device: Device };
