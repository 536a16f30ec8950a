// What a volume is drawn with that was not recorded with it: the colors and the effects chosen on the page.

import { wishedPoints } from "./colors";
import { wishedEffects } from "./effects";

/** Six digits are enough, and shorter. */
const rounded = (_: string, value: unknown) => (typeof value === "number" ? Number(value.toPrecision(6)) : value);

/** As JSON, or null: as recorded. */
export function wishedAppearance(): string | null {
  const [points, effects] = [wishedPoints(), wishedEffects()];
  return points || effects ? JSON.stringify({ points, effects }, rounded) : null;
}
