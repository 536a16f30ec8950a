// The camera, and the hands and keys that move it.

import { nextComparison } from "./compare";
import { flight, looked, moved, toggleFlight } from "./fly";
import { refresh, refreshStatus } from "./frame";
import { pumpSoon, shownDescription } from "./picture";
import { FRONT, IDLE_MS, ZOOM_RANGE, byId, clamp, motion, shownIndex, store, view } from "./state";
import type { Pose } from "./engine/wasm";
import { openHelp } from "./help";
import { toggleOverlay } from "./overlay";
import { togglePlay } from "./play";
import { savePicture } from "./save";
import { choose, followNewest } from "./steps";

/** Farther to the side nothing is left of the volume. */
const PAN_LIMIT = 2;
/** Who flies may turn round far behind it. */
const FLIGHT_LIMIT = 8;

const wrapped = (degrees: number) => ((((degrees + 180) % 360) + 360) % 360) - 180;

function setPose({ azimuth, elevation, zoom, right, up, ahead, roll }: Pose): void {
  view.pose = {
    azimuth: wrapped(azimuth),
    elevation: clamp(elevation, -89, 89),
    zoom: clamp(zoom, ...ZOOM_RANGE),
    right: clamp(right, -FLIGHT_LIMIT, FLIGHT_LIMIT),
    up: clamp(up, -FLIGHT_LIMIT, FLIGHT_LIMIT),
    ahead: clamp(ahead, -FLIGHT_LIMIT, FLIGHT_LIMIT),
    roll: wrapped(roll),
  };
  moving();
}

const turnBy = (azimuth: number, elevation: number) =>
  setPose({ ...view.pose, azimuth: view.pose.azimuth + azimuth, elevation: view.pose.elevation + elevation });
const lookBy = (azimuth: number, elevation: number) => {
  const camera = shownDescription()?.camera;
  if (camera) setPose(looked(view.pose, azimuth, elevation, camera.fov_y_deg));
};
const flyBy = (right: number, up: number, ahead: number) => setPose(moved(view.pose, [right, up, ahead]));
const panBy = (right: number, up: number) => {
  const limit = (shift: number) => (flight.on ? shift : clamp(shift, -PAN_LIMIT, PAN_LIMIT));
  setPose({ ...view.pose, right: limit(view.pose.right + right), up: limit(view.pose.up + up) });
};
const rollBy = (roll: number) => setPose({ ...view.pose, roll: view.pose.roll + roll });
export const zoomBy = (factor: number) => setPose({ ...view.pose, zoom: view.pose.zoom * factor });

/** Something changes: drafts are enough until it has been still for a moment. */
export function moving(): void {
  clearTimeout(motion.timer);
  motion.timer = setTimeout(() => {
    motion.timer = 0;
    refresh();
  }, IDLE_MS);
  pumpSoon();
  refreshStatus();
}

/** No draft on the way to a place that is already final. */
export function jumpTo(pose: Pose): void {
  setPose(pose);
  clearTimeout(motion.timer);
  motion.timer = 0;
  refresh();
}

export const resetCamera = () => jumpTo(FRONT);

interface Place {
  x: number;
  y: number;
}

/**
 * One pointer orbits: the object follows the hand, half a turn across the picture; who flies looks around. With the shift key, or the middle or
 * right button, it pans; with the alt key it rolls. Two pointers zoom by their distance and pan by their middle.
 */
export function listenToPicture(canvas: HTMLCanvasElement): void {
  const pointers = new Map<number, Place>();
  const pair = () => {
    const [a, b] = [...pointers.values()] as [Place, Place];
    return { spread: Math.hypot(a.x - b.x, a.y - b.y), middle: { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 } };
  };
  const pan = (dx: number, dy: number) => panBy(-dx / canvas.clientHeight / view.pose.zoom, dy / canvas.clientHeight / view.pose.zoom);
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const [dx, dy] = [event.clientX - last.x, event.clientY - last.y];
    if (dx === 0 && dy === 0) return;
    const before = pointers.size === 2 ? pair() : null;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    motion.held = true;
    canvas.classList.add("turning");
    const scale = 180 / canvas.clientWidth;
    if (before) {
      const { spread, middle } = pair();
      if (before.spread > 0) zoomBy(spread / before.spread);
      pan(middle.x - before.middle.x, middle.y - before.middle.y);
    } else if (pointers.size > 2) return;
    else if (event.shiftKey || (event.buttons & 6) !== 0) pan(dx, dy);
    else if (event.altKey) rollBy(dx * scale);
    else if (flight.on) lookBy(dx * LOOK * scale, -dy * LOOK * scale);
    else turnBy(-dx * scale, dy * scale);
  });
  const release = (event: PointerEvent) => {
    if (!pointers.delete(event.pointerId) || pointers.size > 0) return;
    motion.held = false;
    canvas.classList.remove("turning");
    refresh();
  };
  // On the window: the pointer may be let go anywhere.
  window.addEventListener("pointerup", release);
  window.addEventListener("pointercancel", release);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", resetCamera);
  canvas.addEventListener("wheel", wheelZoom, { passive: false });
}

function wheelZoom(event: WheelEvent): void {
  event.preventDefault();
  const pixels = event.deltaY * ([1, 16, 400][event.deltaMode] ?? 1);
  const by = -clamp(pixels, -300, 300) * 0.0015;
  if (flight.on) flyBy(0, 0, by);
  else zoomBy(Math.exp(by));
}

/** Looking around turns by less than orbiting: all of the picture moves. */
const LOOK = 0.3;
/** What a key flies, heights of the picture at the target. */
const FLIGHT_STEP = 0.05;

type Keys = Record<string, () => void>;

const CAMERA_KEYS: Keys = {
  ArrowLeft: () => turnBy(-5, 0),
  ArrowRight: () => turnBy(5, 0),
  ArrowUp: () => turnBy(0, 5),
  ArrowDown: () => turnBy(0, -5),
};
const LOOK_KEYS: Keys = {
  ArrowLeft: () => lookBy(5, 0),
  ArrowRight: () => lookBy(-5, 0),
  ArrowUp: () => lookBy(0, -5),
  ArrowDown: () => lookBy(0, 5),
};
const FLIGHT_KEYS: Keys = {
  w: () => flyBy(0, 0, FLIGHT_STEP),
  s: () => flyBy(0, 0, -FLIGHT_STEP),
  a: () => flyBy(-FLIGHT_STEP, 0, 0),
  d: () => flyBy(FLIGHT_STEP, 0, 0),
  e: () => flyBy(0, FLIGHT_STEP, 0),
  q: () => flyBy(0, -FLIGHT_STEP, 0),
};
const PAN_KEYS: Keys = {
  ArrowLeft: () => panBy(-0.05, 0),
  ArrowRight: () => panBy(0.05, 0),
  ArrowUp: () => panBy(0, 0.05),
  ArrowDown: () => panBy(0, -0.05),
};
const PAGE_KEYS: Keys = {
  ",": () => choose(shownIndex() - 1),
  ".": () => choose(shownIndex() + 1),
  "+": () => zoomBy(1.15),
  "=": () => zoomBy(1.15),
  "-": () => zoomBy(1 / 1.15),
  "[": () => rollBy(-5),
  "]": () => rollBy(5),
  "0": resetCamera,
  f: toggleFlight,
  F: toggleFlight,
  c: nextComparison,
  C: nextComparison,
  b: toggleOverlay,
  B: toggleOverlay,
  s: savePicture,
  S: savePicture,
  "?": openHelp,
  " ": togglePlay,
  g: () => byId("generate-here").click(),
  G: () => byId("generate-here").click(),
  l: followNewest,
  L: followNewest,
};
const TIMELINE_KEYS: Keys = {
  ArrowLeft: () => choose(shownIndex() - 1),
  ArrowRight: () => choose(shownIndex() + 1),
  ArrowDown: () => choose(shownIndex() - 1),
  ArrowUp: () => choose(shownIndex() + 1),
  PageDown: () => choose(shownIndex() - 10),
  PageUp: () => choose(shownIndex() + 10),
  Home: () => choose(0),
  End: () => choose(store.steps.length - 1),
};

/** Arrows act on what has the focus: the time line steps, the picture (or a page where nothing has it) turns. */
export function onKey(event: KeyboardEvent): void {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const focus = document.activeElement;
  // Space works the control that has the focus; fields and a sheet have their own keys.
  if ((event.key === " " && focus?.matches("button, summary")) || focus?.matches("input, select")) return;
  if (document.querySelector("dialog[open]")) return;
  const onPicture = focus === byId("picture") || focus === document.body;
  const turning = flight.on ? { ...LOOK_KEYS, ...FLIGHT_KEYS } : CAMERA_KEYS;
  const keys = focus === byId("timeline") ? TIMELINE_KEYS : !onPicture ? {} : event.shiftKey ? PAN_KEYS : turning;
  const action = keys[event.key] ?? PAGE_KEYS[event.key];
  if (!action) return;
  event.preventDefault();
  action();
}
