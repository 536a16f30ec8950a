// The editor of a volume's transfer function. Where a step is a volume, its colors are chosen here;
// what the recorded function leaves transparent was not recorded, is hatched, and stays transparent.

import type { ControlPoint, StepRow, Transfer } from "./api";
import { moving } from "./camera";
import { refresh } from "./frame";
import { keepHistory, mayRedo, mayUndo, redo, remember, undo } from "./history";
import { painter } from "./picture";
import { type Point, GUTTER, gridLine, pathOf, significant } from "./plots";
import { RETRY_MS, byId, clamp, link, motion, picture, shownRow, store } from "./state";
import { PRESETS } from "./presets";
import { fromHex, hex } from "./rgb";
import { type Asked, askToShow, drawAsked } from "./show";
import { setText } from "./status";
import { classified, valueAt } from "./transfer";

/** `recorded`: what the server said of run `run`; `points: null` draws as recorded; `selected` is a position in `points`. */
interface Colors {
  run: string | null;
  recorded: Transfer | null;
  points: ControlPoint[] | null;
  selected: number;
  /** Of a VDI: what the generator-node says. */
  stated: boolean;
  loading: boolean;
  retryAt: number;
}

const colors: Colors = { run: null, recorded: null, points: null, selected: 0, stated: false, loading: false, retryAt: 0 };

type Points = ControlPoint[] | null;

/** Colors of a link, until it is known what was recorded. */
const linked: { points: Points } = { points: null };

const asked: Asked = { message: "", refused: false };

const CURVE_BOTTOM = 92;
const CURVE_TOP = 8;
/** Pixels from a point within which a press takes hold of it. */
const REACH = 14;

/** Control points to draw the shown step with, or none: as recorded, or not a volume. */
export function wishedPoints(): Points {
  if (shownRow()?.representation !== "volume") return null;
  return colors.run === store.run?.id ? (colors.stated ? null : colors.points) : linked.points;
}

/** Draws with the colors of a link; null: with those that were recorded. */
export function takePoints(points: Points): void {
  if (colors.run !== null && colors.run === store.run?.id && !colors.stated) put(points);
  else linked.points = points;
}

const editedPoints = (): ControlPoint[] => colors.points ?? colors.recorded?.points ?? [];

function takeRecorded(run: string, recorded: Transfer): void {
  Object.assign(colors, { run, recorded, points: linked.points, selected: 0, stated: false });
  linked.points = null;
}

async function loadColors(row: StepRow): Promise<void> {
  const wait = colors.loading || performance.now() < colors.retryAt;
  if (wait || link.phase !== "live" || !store.run || (colors.run === store.run.id && !colors.stated)) return;
  const run = store.run.id;
  // The worker knows a step that it holds; the server is asked where it draws.
  const held = painter?.description(run, row.step);
  if (held?.transfer) {
    const { transfer, unrecorded, histogram } = held;
    takeRecorded(run, { ...transfer, unrecorded, histogram });
    return refresh();
  }
  if (painter && picture.shown?.by !== "server") return;
  colors.loading = true;
  try {
    const answer = await fetch(`api/transfer?step=${row.step}`, { cache: "no-store" });
    if (answer.ok) takeRecorded(run, (await answer.json()) as Transfer);
  } catch {
    // Asked again below.
  }
  colors.loading = false;
  if (colors.run !== run) {
    colors.retryAt = performance.now() + RETRY_MS;
    setTimeout(refresh, RETRY_MS + 10);
  }
  if (colors.run === run) refresh();
}

/** The colors of a VDI are those that the generator-node draws with: changed here, they are to be asked for. */
function stateColors(): void {
  const { run, steerable } = store;
  if (!run || colors.run === run.id || !steerable.transfer || !store.maySteer) return;
  const recorded = { ...steerable.transfer, unrecorded: [] };
  Object.assign(colors, { run: run.id, recorded, points: null, selected: 0, stated: true });
}

// ---- Drawing ---------------------------------------------------------------------------------------------------------

function curveScale() {
  const width = byId("curve").clientWidth;
  const right = width - 8;
  return {
    width,
    x: (at: number) => GUTTER + at * (right - GUTTER),
    // By the cube root, so that a thousandth is seen beside one.
    y: (opacity: number) => CURVE_BOTTOM - Math.cbrt(opacity) * (CURVE_BOTTOM - CURVE_TOP),
    at: (x: number) => clamp((x - GUTTER) / (right - GUTTER), 0, 1),
    opacity: (y: number) => clamp((CURVE_BOTTOM - y) / (CURVE_BOTTOM - CURVE_TOP), 0, 1) ** 3,
  };
}

/** The scalar at position `at` of the range. */
const scalarAt = (at: number): number => valueAt(colors.recorded!.range, at);

export function drawColors() {
  const row = shownRow();
  byId("colors").hidden = !row;
  if (!row || !byId<HTMLDetailsElement>("colors").open) return;
  const isVolume = row.representation === "volume";
  if (isVolume) void loadColors(row);
  else stateColors();
  const ready = colors.run === store.run?.id && (isVolume ? !colors.stated : colors.stated);
  byId("editor").hidden = !ready;
  byId("fixed").hidden = isVolume || ready;
  if (!ready) return;
  drawCurve();
  const ask = byId<HTMLButtonElement>("ask-colors");
  ask.hidden = !store.maySteer || store.steerable.transfer === null;
  ask.disabled = colors.points === null;
  byId<HTMLButtonElement>("undo-colors").disabled = !mayUndo();
  byId<HTMLButtonElement>("redo-colors").disabled = !mayRedo();
  drawAsked("colors-message", asked);
}

function drawCurve() {
  const { x, y, width } = curveScale();
  const points = editedPoints();
  const { unrecorded, range } = colors.recorded!;
  const ends = [{ ...points[0]!, at: 0 }, ...points, { ...points[points.length - 1]!, at: 1 }];
  const line = pathOf(ends.map((p): Point => [x(p.at), y(p.opacity)]));
  const stops = points.map((p) => `<stop offset="${p.at}" stop-color="${hex(p.color)}"/>`).join("");
  const hatched = unrecorded.filter(([a, b]) => b > a)
    .map(([a, b]) => `<rect class="unrecorded" x="${x(a)}" y="${CURVE_TOP}" width="${x(b) - x(a)}" height="${CURVE_BOTTOM - CURVE_TOP}"/>`);
  const scalar = (at: number, px: number, anchor: string) => `<text x="${px}" y="${CURVE_BOTTOM + 15}" text-anchor="${anchor}">${significant(scalarAt(at), 3)}</text>`;
  byId("curve").firstElementChild!.innerHTML = [
    `<defs><linearGradient id="along" gradientUnits="userSpaceOnUse" x1="${x(0)}" x2="${x(1)}" y1="0" y2="0">${stops}</linearGradient>
     <pattern id="hatch" width="6" height="6" patternUnits="userSpaceOnUse" patternTransform="rotate(45)"><path class="hatch" d="M0 0V6"/></pattern></defs>`,
    ...[0.001, 0.01, 0.1, 1].map((o) => gridLine(y(o), width, String(o))),
    `<path fill="url(#along)" fill-opacity="0.85" d="${line}V${CURVE_BOTTOM}H${x(0)}Z"/><path class="curve" d="${line}"/>`,
    ...bars(x),
    ...hatched,
    ...points.map((p, i) => `<circle class="corner" data-selected="${i === colors.selected}" cx="${x(p.at)}" cy="${y(p.opacity)}" r="5" fill="${hex(p.color)}"/>`),
    scalar(0, x(0), "start"),
    `<text x="${(x(0) + x(1)) / 2}" y="${CURVE_BOTTOM + 15}" text-anchor="middle">${range.scale === "log10" ? "logarithmic" : ""}</text>`,
    scalar(1, x(1), "end"),
  ].join("");
  const { at, opacity, color } = points[colors.selected]!;
  setText(byId("corner"), `${significant(scalarAt(at), 4)}: opacity ${significant(opacity, 3)}`);
  const chosen = byId<HTMLInputElement>("corner-color");
  if (chosen.value !== hex(color)) chosen.value = hex(color);
  byId<HTMLButtonElement>("remove-corner").disabled = points.length < 2;
  byId<HTMLButtonElement>("recorded-colors").disabled = colors.points === null;
}

/** The histogram by its logarithm: one point is seen beside a million. */
function bars(x: (at: number) => number): string[] {
  const counts = colors.recorded?.histogram ?? [];
  const most = Math.log1p(Math.max(...counts, 1));
  return counts.map((count, n) => {
    const height = (Math.log1p(count) / most) * (CURVE_BOTTOM - CURVE_TOP);
    const [left, right] = [x(n / counts.length), x((n + 1) / counts.length)];
    return `<rect class="bar" x="${left.toFixed(1)}" y="${(CURVE_BOTTOM - height).toFixed(1)}" width="${(right - left).toFixed(1)}" height="${height.toFixed(1)}"/>`;
  });
}

/** The points in the colors of a map, with one more at each of its own places. */
function applyPreset(name: string): void {
  const map = PRESETS[name];
  if (!map || !colors.recorded) return;
  const last = map.length - 1;
  const colorAt = (at: number): ControlPoint["color"] => {
    const low = Math.min(Math.floor(at * last), last - 1);
    const [a, b] = [fromHex(map[low]!), fromHex(map[low + 1]!)];
    return a.map((c, i) => c + (at * last - low) * (b[i]! - c)) as ControlPoint["color"];
  };
  const points = editedPoints();
  const places = map.map((_, n) => n / last).filter((at) => points.every((p) => Math.abs(p.at - at) > 1e-3));
  const added = places.map((at) => ({ at, opacity: classified(points, at).opacity }));
  const all = [...points, ...added].sort((a, b) => a.at - b.at);
  setPoints(all.map(({ at, opacity }) => ({ at, opacity, color: colorAt(at) })), 0);
}

// ---- Editing ---------------------------------------------------------------------------------------------------------

/** Puts `points` in the place of what is drawn, to be taken back. */
function setPoints(points: Points, selected = colors.selected, continues = false): void {
  remember(continues);
  put(points, selected);
}

/** The camera's drafts serve here too. */
function put(points: Points, selected = colors.selected): void {
  asked.message = "";
  Object.assign(colors, { points, selected: points === null ? 0 : clamp(selected, 0, points.length - 1) });
  moving();
  refresh();
}

function changeSelected(change: Partial<ControlPoint>): void {
  const points = editedPoints().map((p, i) => (i === colors.selected ? { ...p, ...change } : p));
  const [before, after] = [points[colors.selected - 1]?.at ?? 0, points[colors.selected + 1]?.at ?? 1];
  const moved = points[colors.selected]!;
  moved.at = clamp(moved.at, before, after);
  setPoints(points, colors.selected, true);
}

/** A new point at `at`: in the color that is there, and as opaque unless told otherwise. */
function addPoint(at: number, opacity: number | null = null): void {
  const points = editedPoints();
  const next = points.findIndex((p) => p.at > at);
  const index = next < 0 ? points.length : next;
  const [a, b] = [points[Math.max(index - 1, 0)]!, points[Math.min(index, points.length - 1)]!];
  const w = b.at > a.at ? (at - a.at) / (b.at - a.at) : 0;
  const mix = (from: number, to: number) => from + clamp(w, 0, 1) * (to - from);
  const color = a.color.map((c, i) => mix(c, b.color[i]!)) as ControlPoint["color"];
  setPoints(points.toSpliced(index, 0, { at, color, opacity: opacity ?? mix(a.opacity, b.opacity) }), index);
}

function addBesideSelected() {
  const points = editedPoints();
  const [here, next] = [points[colors.selected]!, points[colors.selected + 1]];
  addPoint(next ? (here.at + next.at) / 2 : (here.at + 1) / 2);
}

function removeSelected() {
  if (editedPoints().length > 1) setPoints(editedPoints().toSpliced(colors.selected, 1));
}

function select(index: number): void {
  colors.selected = clamp(index, 0, editedPoints().length - 1);
  refresh();
}

const CORNER_KEYS: Record<string, () => void> = {
  ArrowLeft: () => changeSelected({ at: editedPoints()[colors.selected]!.at - 0.01 }),
  ArrowRight: () => changeSelected({ at: editedPoints()[colors.selected]!.at + 0.01 }),
  ArrowUp: () => raiseSelected(0.02),
  ArrowDown: () => raiseSelected(-0.02),
  PageUp: () => select(colors.selected + 1),
  PageDown: () => select(colors.selected - 1),
  Delete: removeSelected,
  Backspace: removeSelected,
};

const raiseSelected = (by: number) =>
  changeSelected({ opacity: clamp(Math.cbrt(editedPoints()[colors.selected]!.opacity) + by, 0, 1) ** 3 });

/** The point within reach of a place on the curve, or -1. */
function pointAt([px, py]: Point): number {
  const { x, y } = curveScale();
  const far = editedPoints().map((p) => Math.hypot(x(p.at) - px, y(p.opacity) - py));
  const nearest = far.indexOf(Math.min(...far));
  return far[nearest]! > REACH ? -1 : nearest;
}

function listenToCurve(element: HTMLElement): void {
  let held: number | null = null;
  const place = (event: MouseEvent): Point => {
    const box = element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || held !== null) return;
    const nearest = pointAt(place(event));
    if (nearest < 0) return;
    element.setPointerCapture(event.pointerId);
    [held, motion.held] = [event.pointerId, true];
    select(nearest);
  });
  element.addEventListener("pointermove", (event) => {
    // Hidden while held, the curve has no width.
    if (held !== event.pointerId || element.clientWidth === 0) return;
    const [scale, [px, py]] = [curveScale(), place(event)];
    changeSelected({ at: scale.at(px), opacity: scale.opacity(py) });
  });
  const release = (event: PointerEvent) => {
    if (held !== event.pointerId) return;
    [held, motion.held] = [null, false];
    refresh();
  };
  // On the window: the pointer may be let go anywhere.
  window.addEventListener("pointerup", release);
  window.addEventListener("pointercancel", release);
  element.addEventListener("dblclick", (event) => {
    const [scale, [px, py]] = [curveScale(), place(event)];
    if (pointAt([px, py]) < 0) addPoint(scale.at(px), scale.opacity(py));
  });
  element.addEventListener("keydown", (event) => {
    const action = CORNER_KEYS[event.key];
    if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    action();
  });
}

export function listenToColors() {
  listenToCurve(byId("curve"));
  byId("colors").addEventListener("toggle", refresh);
  byId("corner-color").addEventListener("input", () => changeSelected({ color: fromHex(byId<HTMLInputElement>("corner-color").value) }));
  byId("previous-corner").addEventListener("click", () => select(colors.selected - 1));
  byId("next-corner").addEventListener("click", () => select(colors.selected + 1));
  byId("add-corner").addEventListener("click", addBesideSelected);
  byId("remove-corner").addEventListener("click", removeSelected);
  const preset = byId<HTMLSelectElement>("preset");
  preset.addEventListener("change", () => {
    applyPreset(preset.value);
    preset.value = "";
  });
  byId("recorded-colors").addEventListener("click", () => setPoints(null));
  byId("ask-colors").addEventListener("click", () => void askToShow({ points: editedPoints() }, asked));
  byId("undo-colors").addEventListener("click", undo);
  byId("redo-colors").addEventListener("click", redo);
  keepHistory({ get: () => colors.points, put });
}
