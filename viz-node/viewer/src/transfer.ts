// A transfer function: the values of its range, and color and opacity between its points.

import type { ControlPoint, TransferFunction } from "./engine/wasm";
import { clamp } from "./state";

/** The value at position `at` of the range. */
export function valueAt({ lo, hi, scale }: TransferFunction["range"], at: number): number {
  return scale === "log10" ? lo * (hi / lo) ** at : lo + at * (hi - lo);
}

/** The position of `value` in the range. */
export function positionOf({ lo, hi, scale }: TransferFunction["range"], value: number): number {
  return scale === "log10" ? Math.log(value / lo) / Math.log(hi / lo) : (value - lo) / (hi - lo);
}

/** Color and opacity at `at`: linear between the points, constant beyond them. */
export function classified(points: ControlPoint[], at: number): Omit<ControlPoint, "at"> {
  const next = points.findIndex((point) => point.at >= at);
  const [a, b] = [points[Math.max(next < 0 ? points.length - 1 : next - 1, 0)]!, points[next < 0 ? points.length - 1 : next]!];
  const share = b.at > a.at ? clamp((at - a.at) / (b.at - a.at), 0, 1) : 0;
  const mix = (from: number, to: number): number => from + share * (to - from);
  return { color: a.color.map((channel, n) => mix(channel, b.color[n]!)) as ControlPoint["color"], opacity: mix(a.opacity, b.opacity) };
}
