// A slice of the shown volume: its values on a plane across an axis, in its colors, and the value under the pointer.

import type { Description, Slice } from "./engine/wasm";
import { painter } from "./picture";
import { significant } from "./plots";
import { byId, clamp, shownRow, store } from "./state";
import { setText } from "./status";
import { classified, valueAt } from "./transfer";

const AXES = ["x", "y", "z"];
/** The axes along the width and the height of a slice across each. */
const ALONG: [number, number][] = [[1, 2], [0, 2], [0, 1]];

interface Shown {
  /** What it was asked by. */
  key: string;
  slice: Slice;
  description: Description;
}

const shown: { now: Shown | null; asking: string | null; pointer: [number, number] | null } = { now: null, asking: null, pointer: null };

const axis = (): number => AXES.indexOf(byId<HTMLSelectElement>("slice-axis").value);
const place = (): number => Number(byId<HTMLInputElement>("slice-at").value);

/** Asks for the slice of the shown step, unless it is there. */
async function ask(): Promise<void> {
  const [row, run] = [shownRow(), store.run];
  if (!painter || !row || !run || shown.asking !== null) return;
  const [across, at] = [axis(), place()];
  const key = JSON.stringify([run.id, row.step, across, at]);
  if (shown.now?.key === key) return;
  shown.asking = key;
  const description = await painter.hold(run.id, row.step).catch(() => null);
  const slice = description && (await painter.slice(run.id, row.step, across, at).catch(() => null));
  shown.asking = null;
  if (!slice) return;
  shown.now = { key, slice, description };
  paint(shown.now);
  // What was chosen meanwhile.
  drawSlices();
}

function paint({ slice: { width, height, units }, description }: Shown): void {
  const canvas = byId<HTMLCanvasElement>("slice");
  [canvas.width, canvas.height] = [width, height];
  const [right, up] = ALONG[axis()]!;
  const side = (n: number) => description.bounds[1][n]! - description.bounds[0][n]!;
  canvas.style.aspectRatio = String(side(right) / side(up));
  const pixels = new ImageData(width, height);
  units.forEach((unit, n) => {
    if (Number.isNaN(unit)) return;
    // Rows come upwards.
    const at = 4 * ((height - 1 - Math.floor(n / width)) * width + (n % width));
    pixels.data.set([...classified(description.transfer!.points, clamp(unit, 0, 1)).color.map((channel) => 255 * channel), 255], at);
  });
  canvas.getContext("2d")!.putImageData(pixels, 0, 0);
  say();
}

/** The value under the pointer, and where that is. */
function say(): void {
  const { now, pointer } = shown;
  if (!now) return;
  const { slice, description } = now;
  const [least, most] = description.bounds;
  const across = axis();
  const at = (n: number, share: number): string => {
    const [side, position] = [most[n]! - least[n]!, least[n]! + share * (most[n]! - least[n]!)];
    // Not the rounding of a middle.
    return `${AXES[n]} = ${significant(Math.abs(position) < 1e-9 * side ? 0 : position, 4)}`;
  };
  const plane = at(across, place());
  if (!pointer) return setText(byId("slice-value"), plane);
  const [column, row] = pointer.map((share, n) => clamp(Math.round(share * ([slice.width, slice.height][n]! - 1)), 0, [slice.width, slice.height][n]! - 1)) as [number, number];
  const unit = slice.units[row * slice.width + column]!;
  const [right, up] = ALONG[across]!;
  const places = [at(right, column / Math.max(slice.width - 1, 1)), at(up, row / Math.max(slice.height - 1, 1)), plane].sort();
  const { range } = description.transfer!;
  const value = Number.isNaN(unit) ? "none" : unit <= 0 ? `at most ${significant(range.lo, 4)}` : unit >= 1 ? `at least ${significant(range.hi, 4)}` : significant(valueAt(range, unit), 4);
  setText(byId("slice-value"), `${value} at ${places.join(", ")}`);
}

export function drawSlices(): void {
  const details = byId<HTMLDetailsElement>("slices");
  details.hidden = painter === null || shownRow()?.representation !== "volume";
  if (!details.hidden && details.open) void ask();
}

export function listenToSlices(): void {
  for (const id of ["slice-axis", "slice-at"]) byId(id).addEventListener("input", drawSlices);
  byId("slices").addEventListener("toggle", drawSlices);
  const canvas = byId<HTMLCanvasElement>("slice");
  canvas.addEventListener("pointermove", (event) => {
    const box = canvas.getBoundingClientRect();
    shown.pointer = [(event.clientX - box.left) / box.width, 1 - (event.clientY - box.top) / box.height];
    say();
  });
  canvas.addEventListener("pointerleave", () => {
    shown.pointer = null;
    say();
  });
}
