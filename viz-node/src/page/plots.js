// Numbers as they are written, and drawings over steps: plots, quality against time, the time line.
"use strict";

const fixed = (x, digits) => (Number.isFinite(x) ? x.toFixed(digits) : "–");
const significant = (x, digits) => (Number.isFinite(x) ? String(Number(x.toPrecision(digits))) : "–");
const kilobytes = (bytes) => (Number.isFinite(bytes) ? bytes / 1000 : null);
/** JSON has no infinity: identical pictures come as "inf". */
const decibels = (value) => (value === "inf" ? Infinity : value);

function decibelText(value) {
  if (value === Infinity) return "∞";
  return Number.isFinite(value) ? value.toFixed(1) : "–";
}

/** Round numbers, at most about `count`, that lie within `low`..`high`. */
function niceTicks(low, high, count) {
  if (!(high > low)) return [];
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const unit = [1, 2, 5, 10].find((m) => m * power >= rough * (1 - 1e-9)) * power;
  const ticks = [];
  for (let k = Math.ceil(low / unit - 1e-9); k * unit <= high * (1 + 1e-9); k++) ticks.push(Number((k * unit).toPrecision(12)));
  return ticks;
}

// ---- Drawings over steps ---------------------------------------------------------------------------------------------

const PLOTS = [
  { id: "size", label: "Size", unit: "kB", value: (r) => kilobytes(r.size_bytes), bound: () => kilobytes(store.limit.size_bytes), text: (x) => fixed(x, x < 100 ? 1 : 0) },
  { id: "time", label: "Generation", unit: "ms", value: (r) => r.generation_ms, bound: () => store.limit.time_ms, text: (x) => fixed(x, 1) },
  { id: "psnr", label: "PSNR", unit: "dB", value: (r) => decibels(r.psnr_db), bound: () => null, text: decibelText, floating: true },
];
const GUTTER = 34;

/** Maps step numbers to x; a single step stands in the middle. */
function stepScale(left, right) {
  const first = store.steps[0]?.step ?? 0;
  const span = (newest()?.step ?? 0) - first;
  return {
    x: (step) => (span === 0 ? (left + right) / 2 : left + ((step - first) / span) * (right - left)),
    step: (x) => first + clamp((x - left) / (right - left), 0, 1) * span,
  };
}

/** A range of values to draw: from zero, or for decibels around the data; the bound is always inside. No data: no range. */
function valueRange(values, bound, floating) {
  const finite = values.filter(Number.isFinite);
  if (bound !== null) finite.push(bound);
  if (finite.length === 0) return [0, NaN];
  const [low, high] = finite.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
  if (!floating) return [0, high > 0 ? high * 1.08 : 1];
  const margin = Math.max((high - low) * 0.12, 0.5);
  return [low - margin, high + margin];
}

/** At most the lowest and highest point of each pixel column, so that ten thousand steps draw like five hundred. */
function thinned(points, width) {
  if (points.length <= 2 * width) return points;
  const columns = new Map();
  for (const point of points) {
    const column = Math.floor(point[0]);
    const pair = columns.get(column);
    if (!pair) columns.set(column, [point, point]);
    else columns.set(column, [point[1] < pair[0][1] ? point : pair[0], point[1] > pair[1][1] ? point : pair[1]]);
  }
  return [...columns.values()].flat();
}

const pathOf = (points) => points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
const triangles = (points) => points.map(([x, y]) => `M${x.toFixed(1)} ${(y - 4).toFixed(1)}l4 7h-8z`).join("");

function drawPlot(plot) {
  const box = byId(plot.id).querySelector(".plot");
  const [width, height] = [box.clientWidth, box.clientHeight];
  const bound = plot.bound();
  const rows = store.steps.filter((row) => plot.value(row) !== null);
  const [low, high] = valueRange(rows.map(plot.value), bound, plot.floating);
  const [top, bottom] = [8, height - 5];
  // An infinite PSNR is drawn on the upper edge, where its own tick says so.
  const y = (v) => (v === Infinity ? top - 4 : bottom - ((v - low) / (high - low)) * (bottom - top));
  const { x } = stepScale(GUTTER, width - 8);
  const points = rows.map((row) => [x(row.step), y(plot.value(row))]);
  const broken = bound === null ? [] : points.filter((_, i) => plot.value(rows[i]) > bound);
  const parts = niceTicks(low, high, 3).map((tick) => gridLine(y(tick), width, String(tick)));
  if (rows.some((row) => plot.value(row) === Infinity)) parts.push(gridLine(top - 4, width, "∞"));
  parts.push(cursor(x, y, plot, height));
  parts.push(`<path class="curve" d="${pathOf(thinned(points, width))}"/>`);
  if (points.length <= 40) parts.push(...points.map(([px, py]) => dot("dot", px, py, 1.8)));
  if (bound !== null) parts.push(`<path class="bound" d="M${GUTTER} ${y(bound).toFixed(1)}H${width}"/>`);
  parts.push(`<path class="violation" d="${triangles(thinned(broken, width))}"/>`, hereDot(x, y, plot));
  box.firstElementChild.innerHTML = parts.join("");
  captionPlot(plot, bound, broken.length);
}

const dot = (name, x, y, r) => `<circle class="${name}" cx="${x.toFixed(1)}" cy="${y.toFixed(1)}" r="${r}"/>`;

function gridLine(y, width, label) {
  return `<path class="grid" d="M${GUTTER} ${y.toFixed(1)}H${width}"/><text x="${GUTTER - 5}" y="${(y + 4).toFixed(1)}" text-anchor="end">${label}</text>`;
}

function cursor(x, y, plot, height) {
  const row = shownRow();
  return row ? `<path class="cursor" d="M${x(row.step).toFixed(1)} 0V${height}"/>` : "";
}

function hereDot(x, y, plot) {
  const row = shownRow();
  const value = row && plot.value(row);
  return row && value !== null ? dot("here", x(row.step), y(value), 3.5) : "";
}

function captionPlot(plot, bound, broken) {
  const row = shownRow();
  const [name, detail] = byId(plot.id).querySelectorAll("figcaption span");
  name.innerHTML = `${plot.label} <b>${row ? plot.text(plot.value(row)) : "–"}</b> ${plot.unit}`;
  detail.textContent = bound === null ? "" : `limit ${significant(bound, 4)} ${plot.unit}${broken ? `, broken ${broken}×` : ""}`;
}

/** Quality against time: a mark for each measured step and each trial, a line through those that no other beats, the shown step on it or below. */
function drawAccuracy() {
  const box = byId("accuracy").querySelector(".plot");
  const [width, height] = [box.clientWidth, box.clientHeight];
  const measured = (all) => all.filter((row) => Number.isFinite(row.psnr_db));
  const [steps, trials] = [measured(store.steps), measured(store.trials)];
  const rows = [...steps, ...trials].sort((a, b) => a.generation_ms - b.generation_ms);
  const [, slowest] = valueRange(rows.map((row) => row.generation_ms), null, false);
  const [low, high] = valueRange(rows.map((row) => row.psnr_db), null, true);
  const bottom = height - 17;
  const x = (ms) => GUTTER + (ms / slowest) * (width - 8 - GUTTER);
  const y = (db) => bottom - ((db - low) / (high - low)) * (bottom - 8);
  const at = (row) => [x(row.generation_ms), y(row.psnr_db)];
  let best = -Infinity;
  const front = rows.filter((row) => row.psnr_db > best && ((best = row.psnr_db), true));
  // One mark a pixel: a long run's steps lie on one another.
  const marks = (all) => [...new Set(all.map((row) => at(row).map(Math.round).join(" ")))];
  const row = shownRow();
  const known = row && Number.isFinite(row.psnr_db);
  box.firstElementChild.innerHTML = [
    ...niceTicks(low, high, 3).map((tick) => gridLine(y(tick), width, String(tick))),
    ...niceTicks(0, slowest, 4).map((tick) => `<text x="${x(tick).toFixed(1)}" y="${height - 3}" text-anchor="middle">${tick}</text>`),
    `<path class="trial" d="${marks(trials).map((mark) => `M${mark}m-2 0h4m-2-2v4`).join("")}"/>`,
    `<path class="dot" d="${marks(steps).map((mark) => `M${mark}m-1-1h2v2h-2z`).join("")}"/>`,
    `<path class="curve" d="${pathOf(front.map(at))}"/>`,
    known ? dot("here", ...at(row), 3.5) : "",
  ].join("");
  const [name, detail] = byId("accuracy").querySelectorAll("figcaption span");
  name.innerHTML = `PSNR by time <b>${known ? decibelText(row.psnr_db) : "–"}</b> dB`;
  detail.textContent = [known && `in ${fixed(row.generation_ms, 1)} ms`, trials.length && `${trials.length} trials (+)`].filter(Boolean).join(", ");
}

/** Steps as ticks, one a pixel column at most; a step that broke the limit is taller, colored and pointed. */
function drawTimeline() {
  const box = byId("timeline");
  const width = box.clientWidth;
  const { x } = stepScale(10, width - 10);
  const columns = new Map();
  for (const row of store.steps) {
    const column = Math.round(x(row.step));
    columns.set(column, (columns.get(column) ?? true) && row.limit_kept);
  }
  const at = (kept) => [...columns].filter(([, k]) => k === kept).map(([column]) => column);
  const parts = [
    `<path class="grid" d="M0 28.5H${width}"/>`,
    `<path class="tick-kept" d="${at(true).map((c) => `M${c} 20V28`).join("")}"/>`,
    `<path class="violation" d="${at(false).map((c) => `M${c - 1} 14h2V28h-2zM${c} 8l4 7h-8z`).join("")}"/>`,
    timelineHandle(x, width),
  ];
  box.firstElementChild.innerHTML = parts.join("");
  describeTimeline(box);
}

function timelineHandle(x, width) {
  const row = shownRow();
  if (!row) return "";
  const at = x(row.step);
  const label = `step ${row.step}`;
  const half = label.length * 3.2;
  const text = clamp(at, half, width - half);
  const ends = [[store.steps[0].step, 2, "start"], [newest().step, width - 2, "end"]]
    .filter(([step, end]) => step !== row.step && Math.abs(end - text) > half + 50)
    .map(([step, end, anchor]) => `<text x="${end}" y="43" text-anchor="${anchor}">${step}</text>`);
  return `${ends.join("")}<rect class="handle" x="${(at - 2.5).toFixed(1)}" y="4" width="5" height="27" rx="2.5"/>
    <text x="${text.toFixed(1)}" y="43" text-anchor="middle">${label}</text>`;
}

function describeTimeline(box) {
  const row = shownRow();
  box.setAttribute("aria-valuemin", store.steps[0]?.step ?? 0);
  box.setAttribute("aria-valuemax", newest()?.step ?? 0);
  box.setAttribute("aria-valuenow", row?.step ?? 0);
  box.setAttribute("aria-valuetext", row ? `step ${row.step}${row.limit_kept ? "" : ", broke the limit"}` : "no step yet");
}

/** Pressing or dragging over steps shows the nearest one and stays there. */
function listenToSteps(element, left, right) {
  let scrubbing = false;
  const pick = (event) => {
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
    scrubbing = motion.held = false;
    refresh();
  };
  element.addEventListener("pointerup", release);
  element.addEventListener("pointercancel", release);
}
