// A step beside another from the same view: its picture, or how far the two differ.

import { refresh } from "./frame";
import type { Picture } from "./engine/painter";
import { fixed } from "./plots";
import { byId, picture, shownRow, store } from "./state";
import { setText } from "./status";

/** `step`: what the shown step is compared with; null: nothing. */
export const comparison: { run: string | null; step: number | null; difference: boolean } = { run: null, step: null, difference: false };

/** Differences are a few of 255: so many times brighter they are seen. */
const GAIN = 4;

/** Beside the step that is shown now; then their difference; then none. */
export function nextComparison(): void {
  const row = shownRow();
  if (!row) return;
  if (comparison.step === null) Object.assign(comparison, { run: store.run?.id ?? null, step: row.step, difference: false });
  else if (!comparison.difference) comparison.difference = true;
  else Object.assign(comparison, { step: null, difference: false });
  // What is on the stage was drawn for another comparison.
  picture.shown = picture.shown && { ...picture.shown, beside: NaN };
  refresh();
}

export function drawComparison(): void {
  if (comparison.step !== null && comparison.run !== store.run?.id) Object.assign(comparison, { step: null, difference: false });
  byId("stage").toggleAttribute("data-compares", comparison.step !== null);
  byId("beside").hidden = byId("compared").hidden = comparison.step === null;
  byId("compare").setAttribute("aria-pressed", String(comparison.step !== null));
}

/** Shows the other step's picture beside the one that has just been shown, or their difference. */
export function showBeside({ step, bitmap }: Picture): void {
  const [shown, canvas] = [byId<HTMLCanvasElement>("picture"), byId<HTMLCanvasElement>("beside")];
  [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
  const context = canvas.getContext("2d", { willReadFrequently: true })!;
  context.drawImage(bitmap, 0, 0);
  const other = context.getImageData(0, 0, canvas.width, canvas.height);
  const own = shown.getContext("2d", { willReadFrequently: true })!.getImageData(0, 0, canvas.width, canvas.height);
  let squares = 0;
  for (let n = 0; n < other.data.length; n++) {
    const apart = Math.abs(own.data[n]! - other.data[n]!);
    squares += apart * apart;
    if (comparison.difference && n % 4 !== 3) other.data[n] = GAIN * apart;
  }
  if (comparison.difference) context.putImageData(other, 0, 0);
  canvas.dataset.step = String(step);
  const mean = squares / ((3 * other.data.length) / 4) / 255 ** 2;
  const decibels = mean === 0 ? "equal" : `${fixed(-10 * Math.log10(mean), 1)} dB apart`;
  setText(byId("compared"), comparison.difference ? `difference from step ${step}, ${GAIN} times: ${decibels}` : `step ${step}: ${decibels}`);
}
