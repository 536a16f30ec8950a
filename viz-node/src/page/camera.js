// The camera, and the hands and keys that turn it.
"use strict";

function setCamera(azimuth, elevation, zoom) {
  const turn = ((((azimuth + 180) % 360) + 360) % 360) - 180;
  Object.assign(view, { azimuth: turn, elevation: clamp(elevation, -89, 89), zoom: clamp(zoom, ...ZOOM_RANGE) });
  moving();
}

const turnBy = (azimuth, elevation) => setCamera(view.azimuth + azimuth, view.elevation + elevation, view.zoom);
const zoomBy = (factor) => setCamera(view.azimuth, view.elevation, view.zoom * factor);

/** Something changes: drafts are enough until it has been still for a moment. */
function moving() {
  clearTimeout(motion.timer);
  motion.timer = setTimeout(() => {
    motion.timer = 0;
    refresh();
  }, IDLE_MS);
  pumpSoon();
  refreshStatus();
}

/** No draft on the way to a place that is already final. */
function jumpTo(azimuth, elevation, zoom) {
  setCamera(azimuth, elevation, zoom);
  clearTimeout(motion.timer);
  motion.timer = 0;
  refresh();
}

const resetCamera = () => jumpTo(0, 0, 1);

/** One pointer orbits: the object follows the hand, half a turn across the picture. Two zoom by their distance. */
function listenToPicture(canvas) {
  const pointers = new Map();
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const [dx, dy] = [event.clientX - last.x, event.clientY - last.y];
    if (dx === 0 && dy === 0) return;
    const before = pointers.size === 2 ? spread() : 0;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    motion.held = true;
    canvas.classList.add("turning");
    const scale = 180 / canvas.clientWidth;
    if (pointers.size === 1) turnBy(-dx * scale, dy * scale);
    else if (pointers.size === 2 && before > 0) zoomBy(spread() / before);
  });
  const release = (event) => {
    if (!pointers.delete(event.pointerId) || pointers.size > 0) return;
    motion.held = false;
    canvas.classList.remove("turning");
    refresh();
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("dblclick", resetCamera);
  canvas.addEventListener("wheel", wheelZoom, { passive: false });
}

function wheelZoom(event) {
  event.preventDefault();
  const pixels = event.deltaY * [1, 16, 400][event.deltaMode];
  zoomBy(Math.exp(-clamp(pixels, -300, 300) * 0.0015));
}

const CAMERA_KEYS = {
  ArrowLeft: () => turnBy(-5, 0),
  ArrowRight: () => turnBy(5, 0),
  ArrowUp: () => turnBy(0, 5),
  ArrowDown: () => turnBy(0, -5),
};
const PAGE_KEYS = {
  ",": () => choose(shownIndex() - 1),
  ".": () => choose(shownIndex() + 1),
  "+": () => zoomBy(1.15),
  "=": () => zoomBy(1.15),
  "-": () => zoomBy(1 / 1.15),
  "0": resetCamera,
  l: () => followNewest(),
  L: () => followNewest(),
};
const TIMELINE_KEYS = {
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
function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const focus = document.activeElement;
  const arrows = focus === byId("timeline") ? TIMELINE_KEYS : focus === byId("picture") || focus === document.body ? CAMERA_KEYS : {};
  const action = arrows[event.key] ?? PAGE_KEYS[event.key];
  if (!action) return;
  event.preventDefault();
  action();
}
