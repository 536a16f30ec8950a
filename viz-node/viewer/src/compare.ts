// A step beside another from the same view: its picture, or how far the two differ.

import { refresh } from "./frame";
import type { Picture } from "./engine/painter";
import { fixed } from "./plots";
import { byId, shownRow, store } from "./state";
import { setText } from "./status";

interface Comparison {
  run: string | null;
  /** What the shown step is compared with; null: nothing. */
  step: number | null;
  difference: boolean;
  /** The other step's picture that belongs to the one on the stage. */
  other: { step: number; pixels: ImageData } | null;
}

export const comparison: Comparison = { run: null, step: null, difference: false, other: null };

/** Differences are a few of 255: so many times brighter they are seen. */
const GAIN = 4;

/** Beside the step that is shown now; then their difference; then none. */
export function nextComparison(): void {
  const row = shownRow();
  if (!row) return;
  if (comparison.step === null) Object.assign(comparison, { run: store.run?.id ?? null, step: row.step, difference: false });
  else if (!comparison.difference) comparison.difference = true;
  else Object.assign(comparison, { step: null, difference: false });
  paint();
  refresh();
}

export function drawComparison(): void {
  if (comparison.step !== null && comparison.run !== store.run?.id) Object.assign(comparison, { step: null, difference: false });
  if (comparison.step === null) comparison.other = null;
  byId("stage").toggleAttribute("data-compares", comparison.step !== null);
  byId("beside").hidden = byId("compared").hidden = comparison.step === null;
  byId("compare").setAttribute("aria-pressed", String(comparison.step !== null));
}

/** Takes the other step's picture, which belongs to the one that has just been shown. */
export function showBeside({ step, bitmap }: Picture): void {
  const canvas = byId<HTMLCanvasElement>("beside");
  [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
  const context = canvas.getContext("2d", { willReadFrequently: true })!;
  context.drawImage(bitmap, 0, 0);
  comparison.other = { step, pixels: context.getImageData(0, 0, canvas.width, canvas.height) };
  paint();
}

/** Shows the other step's picture, or how far it is from the one on the stage. */
function paint(): void {
  if (comparison.other === null) return;
  const [shown, canvas] = [byId<HTMLCanvasElement>("picture"), byId<HTMLCanvasElement>("beside")];
  const { step, pixels: other } = comparison.other;
  const painted = new ImageData(new Uint8ClampedArray(other.data), other.width, other.height);
  const own = shown.getContext("2d", { willReadFrequently: true })!.getImageData(0, 0, canvas.width, canvas.height);
  let squares = 0;
  for (let n = 0; n < other.data.length; n++) {
    const apart = Math.abs(own.data[n]! - other.data[n]!);
    squares += apart * apart;
    if (comparison.difference && n % 4 !== 3) painted.data[n] = GAIN * apart;
  }
  canvas.getContext("2d")!.putImageData(painted, 0, 0);
  canvas.dataset.step = String(step);
  const mean = squares / ((3 * other.data.length) / 4) / 255 ** 2;
  const decibels = mean === 0 ? "equal" : `${fixed(-10 * Math.log10(mean), 1)} dB apart`;
  setText(byId("compared"), comparison.difference ? `difference from step ${step}, ${GAIN} times: ${decibels}` : `step ${step}: ${decibels}`);
}
