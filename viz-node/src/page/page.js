// The viewer page. It knows steps, measurements and a camera; it never sees a VDI: pictures come rendered from the server.
// Everything shown is a function of `store` (what the server said) and `view` (what the reader chose). Any change calls
// `refresh`, which redraws at most once a frame, so a burst of steps costs one drawing.
"use strict";

const DRAFT_SIZE = 256;
const LARGEST_SIZE = 1024;
const IDLE_MS = 180;
const RETRY_MS = 2000;
const QUIET_MS = 10_000;
const ZOOM_RANGE = [0.25, 8];

const store = { run: null, limit: { size_bytes: null, time_ms: null }, steps: [], trials: [], missed: 0, loaded: false };
/** `step: null` follows the newest; the camera is relative to the generation camera. */
const view = { step: null, azimuth: 0, elevation: 0, zoom: 1 };
const link = { phase: "connecting", loading: null, arrivedWhileLoading: [], lastStepAt: performance.now() };
const motion = { held: false, timer: 0 };
/** `coming`: what was asked for, and what stops the asking. */
const picture = { coming: null, shown: null, refused: null, retryAt: 0, restUntil: 0, notice: "" };

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
  events.addEventListener("trial", loadTrials);
  events.onerror = () => {
    link.phase = "reconnecting";
    // The browser tries again by itself unless the answer was no event stream at all.
    if (events.readyState === EventSource.CLOSED) setTimeout(connect, RETRY_MS);
    refresh();
  };
}

// ---- Words -----------------------------------------------------------------------------------------------------------

function readoutFields(row) {
  const { size_bytes, time_ms } = store.limit;
  const overSize = size_bytes !== null && row.size_bytes > size_bytes;
  const overTime = time_ms !== null && row.generation_ms > time_ms;
  // Limits may have changed since; then the step itself carries the mark.
  const overThen = !row.limit_kept && !overSize && !overTime;
  return [
    ["Step", String(row.step), overThen],
    ["Time", significant(row.time, 5)],
    ["PSNR", row.psnr_db === null ? "not yet" : `${decibelText(decibels(row.psnr_db))} dB`],
    ...(row.representation === "volume"
      ? [["Volume, longest side", `${row.resolution} points`], ["Error bound", significant(row.gamma, 3)]]
      : [["Resolution r", `${row.resolution} × ${row.resolution}`], ["Gamma γ", significant(row.gamma, 3)]]),
    [row.representation === "volume" ? "Points" : "Supersegments", row.supersegments.toLocaleString("en")],
    ["Size", `${fixed(kilobytes(row.size_bytes), 1)} kB`, overSize],
    ["Generation", `${fixed(row.generation_ms, 1)} ms`, overTime],
    ["Encode", `${fixed(row.encode_ms, 1)} ms`],
  ];
}

function drawReadout() {
  const row = shownRow();
  const items = (row ? readoutFields(row) : []).map(([name, value, broken]) => {
    const item = document.createElement("div");
    const [term, detail] = [document.createElement("dt"), document.createElement("dd")];
    [term.textContent, detail.textContent] = [name, value];
    if (broken) {
      detail.className = "broken";
      detail.title = "breaks the limit";
    }
    item.append(term, detail);
    return item;
  });
  byId("readout").replaceChildren(...items);
  drawViews(row?.views ?? []);
}

/** One button a test view: its PSNR, and a way to look from there. Kept across steps so that the focus stays. */
function drawViews(views) {
  const box = byId("views");
  while (box.children.length > views.length) box.lastChild.remove();
  while (box.children.length < views.length) {
    const button = document.createElement("button");
    button.type = "button";
    button.addEventListener("click", () => jumpTo(Number(button.dataset.angle), 0, 1));
    box.append(button);
  }
  views.forEach(({ angle_deg, psnr_db }, i) => {
    const [button, value] = [box.children[i], decibelText(decibels(psnr_db))];
    button.dataset.angle = angle_deg;
    button.title = `Test view at ${angle_deg}°: ${value} dB. Look from there.`;
    button.setAttribute("aria-label", button.title);
    const angle = document.createElement("span");
    angle.textContent = `${angle_deg}°`;
    button.replaceChildren(angle, value);
  });
}

function duration(ms) {
  const seconds = Math.floor(ms / 1000);
  if (seconds < 90) return `${seconds} s`;
  return seconds < 5400 ? `${Math.floor(seconds / 60)} min` : `${Math.floor(seconds / 3600)} h`;
}

function drawRun() {
  const title = document.createElement("b");
  title.textContent = store.run?.name ?? "";
  const facts = [];
  if (store.run) facts.push(store.run.field, store.run.dims?.join(" × "), `${store.steps.length} steps`);
  if (store.missed > 0) facts.push(`${store.missed} missed`);
  const quiet = performance.now() - link.lastStepAt;
  if (store.run && link.phase === "live" && quiet > QUIET_MS) facts.push(`no new step for ${duration(quiet)}`);
  byId("run").replaceChildren(title, facts.length ? `  ${facts.filter(Boolean).join(" · ")}` : "");
  document.title = store.run ? `${store.run.name} – Lamina` : "Lamina";
}

/** The state in a word, and on the stage what to do about it. */
function stateWords() {
  if (link.phase === "reconnecting") {
    return ["reconnecting", "reconnecting", "The viz-node does not answer", "Start it again if it has stopped; this page then goes on by itself."];
  }
  if (link.phase !== "live" || !store.loaded) return ["connecting", "connecting", "Connecting", ""];
  if (!store.run) {
    return ["waiting", "waiting for a simulation", "Waiting for a simulation",
      "Start one that sends its steps to the generator-node, for example: lamina live --generator http://127.0.0.1:7101. Its first step appears here by itself."];
  }
  if (store.steps.length === 0) return ["live", "live", "Waiting for the first step", "The simulation is connected and has published nothing yet."];
  return ["live", "live", picture.shown === null && picture.notice === "" ? "Rendering" : "", ""];
}

function setText(element, text) {
  // Writing the same words again would make a screen reader say them again.
  if (element.textContent !== text) element.textContent = text;
}

function drawState() {
  const [state, word, title, advice] = stateWords();
  byId("state").dataset.state = state;
  setText(byId("state"), word);
  const empty = picture.shown === null || !store.run;
  byId("picture").classList.toggle("empty", empty);
  byId("zoom").hidden = empty;
  const hint = byId("hint");
  hint.hidden = !empty || title === "";
  const [strong, span] = [document.createElement("strong"), document.createElement("span")];
  [strong.textContent, span.textContent] = [title, advice];
  hint.replaceChildren(strong, span);
  const notice = state === "reconnecting" && !empty ? `${title}. ${advice}` : picture.notice;
  byId("notice").hidden = notice === "";
  setText(byId("notice"), notice);
  if (empty) setText(byId("rendered"), "");
  const turned = view.azimuth !== 0 || view.elevation !== 0 || view.zoom !== 1;
  setText(byId("camera"), turned && !empty ? `${fixed(view.azimuth, 0)}°, ${fixed(view.elevation, 0)}°, ×${fixed(view.zoom, 2)}` : "");
}

function drawTransport() {
  const index = shownIndex();
  byId("live").setAttribute("aria-pressed", String(view.step === null));
  byId("previous").disabled = index <= 0;
  byId("next").disabled = index >= store.steps.length - 1;
}

// ---- Drawing once a frame --------------------------------------------------------------------------------------------

let frame = 0;

function refresh() {
  frame ||= requestAnimationFrame(() => {
    frame = 0;
    draw();
    pumpPicture();
  });
}

function draw() {
  drawState();
  drawRun();
  drawTransport();
  drawTimeline();
  drawReadout();
  drawColours();
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
  listenToColours();
  document.addEventListener("keydown", onKey);
  byId("previous").addEventListener("click", () => choose(shownIndex() - 1));
  byId("next").addEventListener("click", () => choose(shownIndex() + 1));
  byId("live").addEventListener("click", followNewest);
  byId("zoom-in").addEventListener("click", () => zoomBy(1.25));
  byId("zoom-out").addEventListener("click", () => zoomBy(1 / 1.25));
  byId("reset").addEventListener("click", resetCamera);
  new ResizeObserver(refresh).observe(byId("stage"));
  new ResizeObserver(refresh).observe(document.querySelector("aside"));
  setInterval(() => store.run && drawRun(), 1000);
  connect();
  refresh();
}

start();
