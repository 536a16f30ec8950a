// The clip box: what of the volume is seen, by six sliders or by the handles over the picture.

import type { ClipBox } from "./engine/wasm";
import type { Projection } from "./projection";
import { byId, clamp, motion } from "./state";
import { type Vector, add, scaled } from "./vector";

/** The least thickness of what is kept, in shares of a side. */
const LEAST = 0.01;

/** Whether the handles are shown, and the last seen picture's projection, by which a handle is dragged. */
const handles: { shown: boolean; seen: Projection | null; bounds: [Vector, Vector] | null } = { shown: false, seen: null, bounds: null };

const slider = (axis: number, end: number) => byId<HTMLInputElement>(`clip-${"xyz"[axis]}-${["from", "to"][end]}`);

/** From and to along each axis, in shares of the side. */
const shares = (): [number, number][] => [0, 1, 2].map((axis) => [Number(slider(axis, 0).value), Number(slider(axis, 1).value)]);

function setShare(axis: number, end: number, share: number): void {
  const [from, to] = shares()[axis]!;
  slider(axis, end).value = String(end === 0 ? clamp(share, 0, to - LEAST) : clamp(share, from + LEAST, 1));
}

/** The clip box that the sliders state; nothing where it is the whole. */
export function statedBox([least, most]: [Vector, Vector]): { clip_box?: ClipBox } {
  const stated = shares();
  if (stated.every(([from, to]) => from === 0 && to === 1)) return {};
  const corner = (end: 0 | 1) => stated.map((share, axis) => least[axis]! + share[end] * (most[axis]! - least[axis]!)) as Vector;
  return { clip_box: { min: corner(0), max: corner(1) } };
}

/** Brings the sliders to a box. */
export function takeBox([least, most]: [Vector, Vector], box: ClipBox | null): void {
  for (const axis of [0, 1, 2]) {
    const share = (corner: Vector) => clamp((corner[axis]! - least[axis]!) / (most[axis]! - least[axis]!), 0, 1);
    slider(axis, 0).value = String(box ? share(box.min) : 0);
    slider(axis, 1).value = String(box ? share(box.max) : 1);
  }
}

export function drawClip(shown: boolean): void {
  handles.shown = shown;
}

/** The middle of a side of the box. */
function middle([least, most]: [Vector, Vector], axis: number, end: number): Vector {
  const stated = shares();
  return [0, 1, 2].map((other) => {
    const [from, to] = stated[other]!;
    const share = other === axis ? stated[axis]![end]! : (from + to) / 2;
    return least[other]! + share * (most[other]! - least[other]!);
  }) as Vector;
}

/** Marks on the six sides, to be dragged. */
export function clipHandles(seen: Projection, bounds: [Vector, Vector]): string[] {
  Object.assign(handles, { seen, bounds });
  if (!handles.shown) return [];
  return [0, 1, 2, 3, 4, 5].flatMap((n) => {
    const place = seen.place(middle(bounds, n >> 1, n & 1));
    if (!place) return [];
    const [x, y] = place.map((c) => c.toFixed(4));
    return `<circle class="clip axis-${"xyz"[n >> 1]}" data-side="${n}" cx="${x}" cy="${y}" r="0.022"/>`;
  });
}

/** How far a side is moved along its axis, in shares of it, by a pointer that goes so far over the picture (halves of its side). */
function dragged(side: number, [dx, dy]: [number, number]): number {
  const { seen, bounds } = handles;
  if (!seen || !bounds) return 0;
  const axis = side >> 1;
  const from = middle(bounds, axis, side & 1);
  const step = 0.01 * (bounds[1][axis]! - bounds[0][axis]!);
  const along = [0, 1, 2].map((n) => (n === axis ? 1 : 0)) as Vector;
  const [a, b] = [seen.place(from), seen.place(add(from, scaled(along, step)))];
  if (!a || !b) return 0;
  const [ux, uy] = [b[0] - a[0], b[1] - a[1]];
  // An axis that points at the eye cannot be dragged along.
  const length = Math.max(ux * ux + uy * uy, 1e-7);
  return (0.01 * (dx * ux + dy * uy)) / length;
}

/** `changed` is called with every movement. */
export function listenToClip(changed: () => void): void {
  for (const axis of [0, 1, 2]) {
    for (const end of [0, 1]) {
      // Ends do not cross.
      slider(axis, end).addEventListener("input", () => setShare(axis, end, Number(slider(axis, end).value)));
    }
  }
  const svg = byId("overlay");
  let held: { pointer: number; side: number; x: number; y: number } | null = null;
  svg.addEventListener("pointerdown", (event) => {
    const side = (event.target as SVGElement).dataset.side;
    if (side === undefined || held) return;
    event.preventDefault();
    held = { pointer: event.pointerId, side: Number(side), x: event.clientX, y: event.clientY };
    motion.held = true;
  });
  // On the window: the handle under the pointer is drawn anew while it is dragged.
  window.addEventListener("pointermove", (event) => {
    if (held?.pointer !== event.pointerId) return;
    const half = svg.getBoundingClientRect().width / 2;
    const moved = dragged(held.side, [(event.clientX - held.x) / half, (event.clientY - held.y) / half]);
    const [axis, end] = [held.side >> 1, held.side & 1];
    Object.assign(held, { x: event.clientX, y: event.clientY });
    setShare(axis, end, shares()[axis]![end]! + moved);
    changed();
  });
  const release = (event: PointerEvent) => {
    if (held?.pointer !== event.pointerId) return;
    held = null;
    motion.held = false;
    changed();
  };
  window.addEventListener("pointerup", release);
  window.addEventListener("pointercancel", release);
}
