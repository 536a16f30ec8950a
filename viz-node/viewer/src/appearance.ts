// What a volume is drawn with that was not recorded with it: the colors and the effects chosen on the page.

import type { ControlPoint } from "./api";
import { takePoints, wishedPoints } from "./colors";
import { takeEffects, wishedEffects } from "./effects";
import type { Effects } from "./engine/wasm";

/** Six digits are enough, and shorter. */
const rounded = (_: string, value: unknown) => (typeof value === "number" ? Number(value.toPrecision(6)) : value);

/** As JSON, or null: as recorded. */
export function wishedAppearance(): string | null {
  const [points, effects] = [wishedPoints(), wishedEffects()];
  return points || effects ? JSON.stringify({ points, effects }, rounded) : null;
}

const MOST_POINTS = 256;

const isShare = (value: unknown): boolean => typeof value === "number" && value >= 0 && value <= 1;

function isPoint(value: unknown): value is ControlPoint {
  const { at, opacity, color } = (value ?? {}) as Partial<ControlPoint>;
  return isShare(at) && isShare(opacity) && Array.isArray(color) && color.length === 3 && color.every(isShare);
}

/** What `JSON` says of an appearance, whoever wrote it; the engine checks the figures of effects. Null: it says none. */
function parsed(json: string): { points: ControlPoint[] | null; effects: Effects | null } | null {
  try {
    const { points = null, effects = null } = JSON.parse(json) as { points?: unknown; effects?: unknown };
    const isList = Array.isArray(points) && points.length > 0 && points.length <= MOST_POINTS && points.every(isPoint);
    const rises = isList && points.every((p, n) => n === 0 || points[n - 1]!.at <= p.at);
    const isEffects = effects === null || (typeof effects === "object" && !Array.isArray(effects));
    return (points === null || rises) && isEffects ? { points: points as ControlPoint[] | null, effects } : null;
  } catch {
    return null;
  }
}

/** Draws with the appearance of a link; as recorded where it states none. */
export function takeAppearance(json: string | null): void {
  const { points, effects } = (json && parsed(json)) || { points: null, effects: null };
  takePoints(points);
  takeEffects(effects);
}
