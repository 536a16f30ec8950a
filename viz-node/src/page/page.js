// The viewer page. It knows steps, measurements and a camera; it never sees a VDI: pictures come rendered from the server.
// Everything shown is a function of `store` (what the server said) and `view` (what the reader chose). Any change calls
// `refresh`, which redraws at most once a frame, so a burst of steps costs one drawing. The camera is the exception: it moves with
// every frame and changes the picture and the status only (`pumpSoon`, `refreshStatus`).
"use strict";

const LARGEST_SIZE = 1024;
const IDLE_MS = 180;
const RETRY_MS = 2000;
const QUIET_MS = 10_000;
const ZOOM_RANGE = [0.25, 8];

const store = { run: null, limit: { size_bytes: null, time_ms: null }, steps: [], trials: [], missed: 0, loaded: false, study: null, studyAt: 0 };
/** `step: null` follows the newest; the camera is relative to the generation camera. */
const view = { step: null, azimuth: 0, elevation: 0, zoom: 1 };
const link = { phase: "connecting", loading: null, arrivedWhileLoading: [], lastStepAt: performance.now() };
const motion = { held: false, timer: 0 };
/** `coming`: what was asked for, and what stops the asking; `decoding`: what has come and is not shown yet. */
const picture = { coming: null, decoding: null, shown: null, refused: null, retryAt: 0, restUntil: 0, restTimer: 0, notice: "" };

const byId = (id) => document.getElementById(id);
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const newest = () => store.steps[store.steps.length - 1] ?? null;

// ---- Steps -----------------------------------------------------------------------------------------------------------

/** The position of the first row whose step is at least `step`. */
function lowerBound(step) {
  let [low, high] = [0, store.steps.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (store.steps[middle].step < step) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Adds a row, or replaces the same step's when its PSNR has come in. */
function upsert(row) {
  const at = lowerBound(row.step);
  const known = store.steps[at]?.step === row.step;
  store.steps.splice(at, known ? 1 : 0, row);
  if (!known) link.lastStepAt = performance.now();
}

function shownIndex() {
  return view.step === null ? store.steps.length - 1 : lowerBound(view.step);
}

const shownRow = () => store.steps[shownIndex()] ?? null;

function choose(index) {
  if (store.steps.length === 0) return;
  view.step = store.steps[clamp(index, 0, store.steps.length - 1)].step;
  refresh();
}

function followNewest() {
  view.step = null;
  refresh();
}

/** The index of the step nearest to step number `step`. */
function nearestIndex(step) {
  const after = clamp(lowerBound(step), 0, store.steps.length - 1);
  const before = Math.max(after - 1, 0);
  return step - store.steps[before].step <= store.steps[after].step - step ? before : after;
}

// ---- Server ----------------------------------------------------------------------------------------------------------

/** Fetches the whole state. Rows that arrive as events meanwhile are newer than the answer and are laid over it. */
async function load() {
  link.loading?.abort();
  const loading = (link.loading = new AbortController());
  link.arrivedWhileLoading = [];
  try {
    const answer = await fetch("api/state", { signal: loading.signal, cache: "no-store" });
    if (!answer.ok) throw new Error(`api/state answered ${answer.status}`);
    const state = await answer.json();
    if (link.loading === loading) accept(state);
  } catch {
    // Superseded by a newer load, or the server is away: then the event stream reports it, and we ask again.
    if (link.loading !== loading) return;
    link.loading = null;
    setTimeout(() => link.phase === "live" && !link.loading && load(), RETRY_MS);
  }
}

/** Fetches what the tuner's trials came to; the answer to an older question never replaces a newer one's. */
async function loadTrials() {
  const asked = (link.trialsAsked = {});
  const answer = await fetch("api/trials", { cache: "no-store" }).catch(() => null);
  if (!answer?.ok) return;
  const trials = await answer.json();
  if (link.trialsAsked !== asked) return;
  store.trials = trials;
  refresh();
}

function accept(state) {
  const sameRun = state.run?.id === store.run?.id;
  store.run = state.run;
  store.limit = state.limit ?? store.limit;
  store.missed = state.missed_steps ?? 0;
  store.steps = (state.steps ?? []).sort((a, b) => a.step - b.step);
  store.loaded = true;
  link.loading = null;
  link.lastStepAt = performance.now();
  if (!sameRun) Object.assign(picture, { shown: null, refused: null, notice: "" });
  link.arrivedWhileLoading.forEach(upsert);
  if (!sameRun) store.trials = [];
  // Of a later study it is not known when it spoke last: it is shown when it speaks again.
  if (state.study?.first) Object.assign(store, { study: state.study, studyAt: performance.now() });
  else if (!sameRun) store.study = null;
  loadTrials();
  if (!sameRun || store.steps[lowerBound(view.step ?? 0)]?.step !== view.step) view.step = null;
  refresh();
}

function connect() {
  const events = new EventSource("api/events");
  events.onopen = () => {
    link.phase = "live";
    load();
    refresh();
  };
  events.addEventListener("step", (event) => {
    const row = JSON.parse(event.data);
    if (link.loading) link.arrivedWhileLoading.push(row);
    else upsert(row);
    refresh();
  });
  events.addEventListener("run", load);
  events.addEventListener("trial", (event) => {
    Object.assign(store, { study: JSON.parse(event.data), studyAt: performance.now() });
    refreshStatus();
    loadTrials();
  });
  events.onerror = () => {
    link.phase = "reconnecting";
    // The browser tries again by itself unless the answer was no event stream at all.
    if (events.readyState === EventSource.CLOSED) setTimeout(connect, RETRY_MS);
    refresh();
  };
}

function drawTransport() {
  const index = shownIndex();
  byId("live").setAttribute("aria-pressed", String(view.step === null));
  byId("previous").disabled = index <= 0;
  byId("next").disabled = index >= store.steps.length - 1;
}

// ---- Drawing once a frame --------------------------------------------------------------------------------------------

/** `everything`: more than the status changed since the last frame. */
const frame = { id: 0, everything: false };

function onFrame() {
  const { everything } = frame;
  Object.assign(frame, { id: 0, everything: false });
  if (everything) {
    // First, so that the server draws while this page does.
    pumpPicture();
    draw();
  } else {
    drawState();
  }
}

function refreshStatus() {
  frame.id ||= requestAnimationFrame(onFrame);
}

function refresh() {
  frame.everything = true;
  refreshStatus();
}

function draw() {
  drawState();
  drawRun();
  drawTransport();
  drawTimeline();
  drawReadout();
  drawColors();
  PLOTS.forEach(drawPlot);
  drawAccuracy();
}

function buildFigures() {
  const build = (id, label) => {
    byId(id).innerHTML = `<figcaption><span></span><span></span></figcaption>
      <div class="plot"><svg role="img" aria-label="${label}"></svg></div>`;
  };
  build("accuracy", "PSNR over generation time, all steps and trials");
  for (const { id, label } of PLOTS) {
    build(id, `${label} over steps`);
    listenToSteps(byId(id).querySelector(".plot"), GUTTER, 8);
  }
}

function start() {
  buildFigures();
  listenToPicture(byId("picture"));
  listenToSteps(byId("timeline"), 10, 10);
  listenToColors();
  document.addEventListener("keydown", onKey);
  byId("previous").addEventListener("click", () => choose(shownIndex() - 1));
  byId("next").addEventListener("click", () => choose(shownIndex() + 1));
  byId("live").addEventListener("click", followNewest);
  byId("zoom-in").addEventListener("click", () => zoomBy(1.25));
  byId("zoom-out").addEventListener("click", () => zoomBy(1 / 1.25));
  byId("reset").addEventListener("click", resetCamera);
  new ResizeObserver(refresh).observe(byId("stage"));
  new ResizeObserver(refresh).observe(document.querySelector("aside"));
  setInterval(() => {
    drawRun();
    refreshStatus();
  }, 1000);
  connect();
  refresh();
}

start();
