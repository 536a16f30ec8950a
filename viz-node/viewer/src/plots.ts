// Numbers as they are written, and drawings over steps: plots, quality against time, the time line.

import type { Decibels, StepRow } from "./api";
import { refresh } from "./frame";
import { byId, clamp, motion, nearestIndex, newest, shownRow, store } from "./state";
import { choose } from "./steps";

const isNumber = (x: unknown): x is number => Number.isFinite(x);

export const fixed = (x: number | null, digits: number): string => (isNumber(x) ? x.toFixed(digits) : "–");
export const significant = (x: number | null, digits: number): string => (isNumber(x) ? String(Number(x.toPrecision(digits))) : "–");
export const kilobytes = (bytes: number | null): number | null => (isNumber(bytes) ? bytes / 1000 : null);
/** JSON has no infinity: identical pictures come as "inf". */
export const decibels = (value: Decibels): number | null => (value === "inf" ? Infinity : value);

export function decibelText(value: number | null): string {
  if (value === Infinity) return "∞";
  return isNumber(value) ? value.toFixed(1) : "–";
}

/** Round numbers, at most about `count`, that lie within `low`..`high`. */
export function niceTicks(low: number, high: number, count: number): number[] {
  if (!(high > low)) return [];
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const unit = [1, 2, 5, 10].find((m) => m * power >= rough * (1 - 1e-9))! * power;
  const ticks = [];
  for (let k = Math.ceil(low / unit - 1e-9); k * unit <= high * (1 + 1e-9); k++) ticks.push(Number((k * unit).toPrecision(12)));
  return ticks;
}

// ---- Drawings over steps ---------------------------------------------------------------------------------------------

export type Point = [number, number];

/** A number of each step, drawn over the steps. */
interface Plot {
  id: string;
  label: string;
  unit: string;
  value: (row: StepRow) => number | null;
  bound: () => number | null;
  text: (value: number | null) => string;
  /** The range is that of the data, not from zero. */
  floating: boolean;
}

export const PLOTS: Plot[] = [
  { id: "size", label: "Size", unit: "kB", value: (r) => kilobytes(r.size_bytes), bound: () => kilobytes(store.limit.size_bytes), text: (x) => fixed(x, (x ?? 0) < 100 ? 1 : 0), floating: false },
  { id: "time", label: "Generation", unit: "ms", value: (r) => r.generation_ms, bound: () => store.limit.time_ms, text: (x) => fixed(x, 1), floating: false },
  { id: "psnr", label: "PSNR", unit: "dB", value: (r) => decibels(r.psnr_db), bound: () => null, text: decibelText, floating: true },
];
export const GUTTER = 34;

/** Maps step numbers to x; a single step stands in the middle. */
function stepScale(left: number, right: number) {
  const first = store.steps[0]?.step ?? 0;
  const span = (newest()?.step ?? 0) - first;
  return {
    x: (step: number) => (span === 0 ? (left + right) / 2 : left + ((step - first) / span) * (right - left)),
    step: (x: number) => first + clamp((x - left) / (right - left), 0, 1) * span,
  };
}

/** A range of values to draw: from zero, or for decibels around the data; the bound is always inside. No data: no range. */
export function valueRange(values: (number | null)[], bound: number | null, floating: boolean): [number, number] {
  const finite = values.filter(isNumber);
  if (bound !== null) finite.push(bound);
  if (finite.length === 0) return [0, NaN];
  const [low, high] = finite.reduce<Point>(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
  if (!floating) return [0, high > 0 ? high * 1.08 : 1];
  const margin = Math.max((high - low) * 0.12, 0.5);
  return [low - margin, high + margin];
}

/** At most the lowest and highest point of each pixel column, so that ten thousand steps draw like five hundred. */
function thinned(points: Point[], width: number): Point[] {
  if (points.length <= 2 * width) return points;
  const columns = new Map<number, [Point, Point]>();
  for (const point of points) {
    const column = Math.floor(point[0]);
    const pair = columns.get(column);
    if (!pair) columns.set(column, [point, point]);
    else columns.set(column, [point[1] < pair[0][1] ? point : pair[0], point[1] > pair[1][1] ? point : pair[1]]);
  }
  return [...columns.values()].flat();
}

export const pathOf = (points: Point[]): string => points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
const triangles = (points: Point[]): string => points.map(([x, y]) => `M${x.toFixed(1)} ${(y - 4).toFixed(1)}l4 7h-8z`).join("");

export function drawPlot(plot: Plot): void {
  const box = byId(plot.id).querySelector<HTMLElement>(".plot")!;
  const [width, height] = [box.clientWidth, box.clientHeight];
  const bound = plot.bound();
  const rows = store.steps.flatMap((row) => {
    const value = plot.value(row);
    return value === null ? [] : [{ step: row.step, value }];
  });
  const [low, high] = valueRange(rows.map(({ value }) => value), bound, plot.floating);
  const [top, bottom] = [8, height - 5];
  // An infinite PSNR is drawn on the upper edge, where its own tick says so.
  const y = (v: number) => (v === Infinity ? top - 4 : bottom - ((v - low) / (high - low)) * (bottom - top));
  const { x } = stepScale(GUTTER, width - 8);
  const points = rows.map(({ step, value }): Point => [x(step), y(value)]);
  const broken = bound === null ? [] : points.filter((_, i) => rows[i]!.value > bound);
  const parts = niceTicks(low, high, 3).map((tick) => gridLine(y(tick), width, String(tick)));
  if (rows.some(({ value }) => value === Infinity)) parts.push(gridLine(top - 4, width, "∞"));
  parts.push(cursor(x, height));
  parts.push(`<path class="curve" d="${pathOf(thinned(points, width))}"/>`);
  if (points.length <= 40) parts.push(...points.map(([px, py]) => dot("dot", px, py, 1.8)));
  if (bound !== null) parts.push(`<path class="bound" d="M${GUTTER} ${y(bound).toFixed(1)}H${width}"/>`);
  parts.push(`<path class="violation" d="${triangles(thinned(broken, width))}"/>`, hereDot(x, y, plot));
  box.firstElementChild!.innerHTML = parts.join("");
  captionPlot(plot, bound, broken.length);
}

export const dot = (name: string, x: number, y: number, r: number): string => `<circle class="${name}" cx="${x.toFixed(1)}" cy="${y.toFixed(1)}" r="${r}"/>`;

export function gridLine(y: number, width: number, label: string): string {
  return `<path class="grid" d="M${GUTTER} ${y.toFixed(1)}H${width}"/><text x="${GUTTER - 5}" y="${(y + 4).toFixed(1)}" text-anchor="end">${label}</text>`;
}

function cursor(x: (step: number) => number, height: number): string {
  const row = shownRow();
  return row ? `<path class="cursor" d="M${x(row.step).toFixed(1)} 0V${height}"/>` : "";
}

function hereDot(x: (step: number) => number, y: (value: number) => number, plot: Plot): string {
  const row = shownRow();
  const value = row && plot.value(row);
  return row && value !== null ? dot("here", x(row.step), y(value), 3.5) : "";
}

export const caption = (id: string) => [...byId(id).querySelectorAll("figcaption span")] as [Element, Element];

function captionPlot(plot: Plot, bound: number | null, broken: number): void {
  const row = shownRow();
  const [name, detail] = caption(plot.id);
  name.innerHTML = `${plot.label} <b>${row ? plot.text(plot.value(row)) : "–"}</b> ${plot.unit}`;
  detail.textContent = bound === null ? "" : `limit ${significant(bound, 4)} ${plot.unit}${broken ? `, broken ${broken}×` : ""}`;
}

/** A measured step or trial: what it cost, and its quality. */
export interface Mark {
  cost: number;
  db: number;
}

/** Those of a finite PSNR. */
export const measured = (rows: StepRow[], cost: (row: StepRow) => number): Mark[] =>
  rows.flatMap((row) => (isNumber(row.psnr_db) ? [{ cost: cost(row), db: row.psnr_db }] : []));

/** The marks that no cheaper one beats, by rising cost. */
export function front(marks: Mark[]): Mark[] {
  let best = -Infinity;
  return [...marks].sort((a, b) => a.cost - b.cost || b.db - a.db).filter(({ db }) => db > best && ((best = db), true));
}

/** Quality against cost, `x` of which is given: the front, trials, steps and the shown one. */
export function drawMarks(box: HTMLElement, x: (cost: number) => number, trials: Mark[], steps: Mark[], shown: Mark | undefined): string {
  const [width, height] = [box.clientWidth, box.clientHeight];
  const all = [...trials, ...steps, ...(shown ? [shown] : [])];
  const { y, low, high } = decibelScale(all, height);
  const at = ({ cost, db }: Mark): Point => [x(cost), y(db)];
  // One mark a pixel: a long run's steps lie on one another.
  const marks = (some: Mark[]) => [...new Set(some.map((mark) => at(mark).map(Math.round).join(" ")))];
  return [
    ...niceTicks(low, high, 3).map((tick) => gridLine(y(tick), width, String(tick))),
    `<path class="trial" d="${marks(trials).map((mark) => `M${mark}m-2 0h4m-2-2v4`).join("")}"/>`,
    `<path class="dot" d="${marks(steps).map((mark) => `M${mark}m-1-1h2v2h-2z`).join("")}"/>`,
    `<path class="curve" d="${pathOf(front([...trials, ...steps]).map(at))}"/>`,
    shown ? dot("here", ...at(shown), 3.5) : "",
  ].join("");
}

/** Maps decibels to y, above the labels of the other axis; the range drawn. */
export function decibelScale(marks: Mark[], height: number) {
  const [low, high] = valueRange(marks.map(({ db }) => db), null, true);
  const bottom = height - 17;
  const y = (db: number) => bottom - ((db - low) / (high - low)) * (bottom - 8);
  return { y, low, high };
}

export const costLabel = (x: number, height: number, text: string): string =>
  `<text x="${x.toFixed(1)}" y="${height - 3}" text-anchor="middle">${text}</text>`;

/** Quality against time: a mark for each measured step and each trial, a line through those that no other beats, the shown step on it or below. */
export function drawAccuracy() {
  const box = byId("accuracy").querySelector<HTMLElement>(".plot")!;
  const ms = (row: StepRow) => row.generation_ms;
  const [steps, trials] = [measured(store.steps, ms), measured(store.trials, ms)];
  const [, slowest] = valueRange([...steps, ...trials].map(({ cost }) => cost), null, false);
  const x = (cost: number) => GUTTER + (cost / slowest) * (box.clientWidth - 8 - GUTTER);
  const row = shownRow();
  const known = row ? measured([row], ms)[0] : undefined;
  box.firstElementChild!.innerHTML =
    niceTicks(0, slowest, 4).map((tick) => costLabel(x(tick), box.clientHeight, String(tick))).join("") +
    drawMarks(box, x, trials, steps, known);
  const [name, detail] = caption("accuracy");
  name.innerHTML = `PSNR by time <b>${known ? decibelText(known.db) : "–"}</b> dB`;
  detail.textContent = [known && `in ${fixed(known.cost, 1)} ms`, trials.length && `${trials.length} trials (+)`].filter(Boolean).join(", ");
}

/** Steps as ticks, one a pixel column at most; a step that broke the limit is taller, colored and pointed. */
export function drawTimeline() {
  const box = byId("timeline");
  const width = box.clientWidth;
  const { x } = stepScale(10, width - 10);
  const columns = new Map<number, boolean>();
  for (const row of store.steps) {
    const column = Math.round(x(row.step));
    columns.set(column, (columns.get(column) ?? true) && row.limit_kept);
  }
  const at = (kept: boolean) => [...columns].filter(([, k]) => k === kept).map(([column]) => column);
  const parts = [
    `<path class="grid" d="M0 28.5H${width}"/>`,
    `<path class="tick-kept" d="${at(true).map((c) => `M${c} 20V28`).join("")}"/>`,
    `<path class="violation" d="${at(false).map((c) => `M${c - 1} 14h2V28h-2zM${c} 8l4 7h-8z`).join("")}"/>`,
    timelineHandle(x, width),
  ];
  box.firstElementChild!.innerHTML = parts.join("");
  describeTimeline(box);
}

function timelineHandle(x: (step: number) => number, width: number): string {
  const row = shownRow();
  if (!row) return "";
  const at = x(row.step);
  const label = `step ${row.step}`;
  const half = label.length * 3.2;
  const text = clamp(at, half, width - half);
  const all: [number, number, string][] = [[store.steps[0]!.step, 2, "start"], [newest()!.step, width - 2, "end"]];
  const ends = all
    .filter(([step, end]) => step !== row.step && Math.abs(end - text) > half + 50)
    .map(([step, end, anchor]) => `<text x="${end}" y="43" text-anchor="${anchor}">${step}</text>`);
  return `${ends.join("")}<rect class="handle" x="${(at - 2.5).toFixed(1)}" y="4" width="5" height="27" rx="2.5"/>
    <text x="${text.toFixed(1)}" y="43" text-anchor="middle">${label}</text>`;
}

function describeTimeline(box: HTMLElement): void {
  const row = shownRow();
  box.setAttribute("aria-valuemin", String(store.steps[0]?.step ?? 0));
  box.setAttribute("aria-valuemax", String(newest()?.step ?? 0));
  box.setAttribute("aria-valuenow", String(row?.step ?? 0));
  box.setAttribute("aria-valuetext", row ? `step ${row.step}${row.limit_kept ? "" : ", broke the limit"}` : "no step yet");
}

/** Pressing or dragging over steps shows the nearest one and stays there. */
export function listenToSteps(element: HTMLElement, left: number, right: number): void {
  let scrubbing = false;
  const pick = (event: PointerEvent) => {
    if (store.steps.length === 0) return;
    const box = element.getBoundingClientRect();
    choose(nearestIndex(stepScale(left, box.width - right).step(event.clientX - box.left)));
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    element.setPointerCapture(event.pointerId);
    scrubbing = true;
    pick(event);
  });
  element.addEventListener("pointermove", (event) => {
    if (!scrubbing) return;
    motion.held = true;
    pick(event);
  });
  const release = () => {
    if (!scrubbing) return;
    scrubbing = motion.held = false;
    refresh();
  };
  // On the window: the pointer may be let go anywhere.
  window.addEventListener("pointerup", release);
  window.addEventListener("pointercancel", release);
}
