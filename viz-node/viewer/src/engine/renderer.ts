// What draws a step that the engine holds on a GPU: WebGPU, or WebGL2 where a browser gives no other.

import type { Description, Pose } from "./wasm";

/** Rows of a still picture drawn at a time; a band begins at a multiple of what offsets of WebGPU's buffers have to be. */
export const BAND_ROWS = 64;

export interface Renderer {
  readonly api: "WebGPU" | "WebGL2";
  /** The device. */
  readonly name: string;
  /** Why the device is gone, once it is. */
  readonly lost: string | null;
  /** Whether step `handle` can be drawn now; if not, its kernel is compiled, and then `compiled` called. */
  ready(handle: number, description: Description, compiled: () => void): boolean;
  /** A picture of step `handle`, which is ready; null if it is no longer `wanted`. A device that fails once is lost. */
  draw(handle: number, pose: Pose, side: number, still: boolean, wanted: () => boolean): Promise<ImageBitmap | null>;
  forget(handle: number): void;
}
