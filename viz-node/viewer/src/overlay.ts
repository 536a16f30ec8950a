// The volume's box, axes and a scale, drawn over the picture from the same camera; and the handles of the clip box.

import { clipHandles } from "./clip";
import { shownDescription } from "./picture";
import { significant } from "./plots";
import { type Projection, projection } from "./projection";
import { byId, clamp, picture } from "./state";
import type { Vector } from "./vector";

/** Whether it is wanted. */
export const overlay = { shown: false };

/** Middle and arm of the axes in the corner, halves of the picture's side. */
const TRIAD = { at: [-0.86, 0.84], arm: 0.09 } as const;
/** The most of the picture's width that the scale takes. */
const LONGEST_SCALE = 0.25;

const AXES: Vector[] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

export function toggleOverlay(): void {
  overlay.shown = !overlay.shown;
  byId("box").setAttribute("aria-pressed", String(overlay.shown));
  drawOverlay();
}

const at = (place: readonly [number, number]): string => place.map((c) => c.toFixed(4)).join(" ");

/** Follows the picture on the stage, not the camera that is ahead of it. */
export function drawOverlay(): void {
  const svg = byId("overlay");
  const description = shownDescription();
  if (!picture.shown || !description) {
    svg.replaceChildren();
    return;
  }
  const seen = projection(description.camera, picture.shown.pose);
  const parts = overlay.shown ? [...boxParts(seen, description.bounds), ...triadParts(seen), ...scaleParts(seen)] : [];
  svg.innerHTML = [...parts, ...clipHandles(seen, description.bounds)].join("");
}

function boxParts({ place }: Projection, bounds: [Vector, Vector]): string[] {
  const corner = (n: number): Vector => [0, 1, 2].map((axis) => bounds[(n >> axis) & 1]![axis]!) as Vector;
  const parts: string[] = [];
  for (let n = 0; n < 8; n++) {
    for (let axis = 0; axis < 3; axis++) {
      const other = n | (1 << axis);
      const [a, b] = [place(corner(n)), place(corner(other))];
      if (other === n || !a || !b) continue;
      const name = n === 0 ? ` axis-${"xyz"[axis]}` : "";
      parts.push(`<path class="edge${name}" d="M${at(a)}L${at(b)}"/>`);
      if (n === 0) {
        const text = `${"xyz"[axis]} ${significant(bounds[0][axis]!, 3)} to ${significant(bounds[1][axis]!, 3)}`;
        const [x, y] = [clamp(b[0] * 1.04, -0.82, 0.82), clamp(b[1] * 1.04, -0.94, 0.97)];
        parts.push(`<text x="${x.toFixed(4)}" y="${y.toFixed(4)}" text-anchor="middle">${text}</text>`);
      }
    }
  }
  return parts;
}

/** Which way the axes point. */
function triadParts({ direction }: Projection): string[] {
  const [x, y] = TRIAD.at;
  return AXES.map((axis, n) => {
    const [right, down] = direction(axis);
    const end = [x + TRIAD.arm * right, y + TRIAD.arm * down] as const;
    return `<path class="triad axis-${"xyz"[n]}" d="M${x} ${y}L${at(end)}"/>`;
  });
}

/** The largest of 1, 2 and 5 times a power of ten that is not above `most`. */
export function roundLength(most: number): number {
  const power = 10 ** Math.floor(Math.log10(most));
  return (most >= 5 * power ? 5 : most >= 2 * power ? 2 : 1) * power;
}

/** A bar of round length at the target's depth, world units. */
function scaleParts({ height }: Projection): string[] {
  const length = roundLength(LONGEST_SCALE * height);
  const [right, y] = [0.94, 0.9];
  const left = right - (2 * length) / height;
  const text = `<text x="${((left + right) / 2).toFixed(4)}" y="${y - 0.025}" text-anchor="middle">${significant(length, 3)}</text>`;
  return [`<path class="scale" d="M${at([left, y - 0.015])}V${y}H${right}V${y - 0.015}"/>`, text];
}
