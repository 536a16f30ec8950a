// The server's state, and its events.

import type { PageState, Steerable, StepRow, Study, Tuner } from "./api";
import { refresh, refreshStatus } from "./frame";
import { RETRY_MS, cameraAsked, link, lowerBound, picture, store, upsert, view } from "./state";

/** Fetches the whole state. Rows that arrive as events meanwhile are newer than the answer and are laid over it. */
async function load(): Promise<void> {
  link.loading?.abort();
  const loading = (link.loading = new AbortController());
  link.arrivedWhileLoading = [];
  try {
    const answer = await fetch("api/state", { signal: loading.signal, cache: "no-store" });
    if (!answer.ok) throw new Error(`api/state answered ${answer.status}`);
    const state = (await answer.json()) as PageState;
    if (link.loading === loading) accept(state);
  } catch {
    // Superseded by a newer load, or the server is away: then the event stream reports it, and we ask again.
    if (link.loading !== loading) return;
    link.loading = null;
    setTimeout(() => link.phase === "live" && !link.loading && void load(), RETRY_MS);
  }
}

/** Fetches what the tuner's trials came to; the answer to an older question never replaces a newer one's. */
async function loadTrials(): Promise<void> {
  const asked = (link.trialsAsked = {});
  const answer = await fetch("api/trials", { cache: "no-store" }).catch(() => null);
  if (!answer?.ok) return;
  const trials = (await answer.json()) as StepRow[];
  if (link.trialsAsked !== asked) return;
  store.trials = trials;
  refresh();
}

function accept(state: PageState): void {
  const known = store.run;
  const sameRun = state.run?.id === known?.id;
  store.run = state.run;
  store.limit = state.limit ?? store.limit;
  store.missed = state.missed_steps ?? 0;
  store.tuner = state.tuner ?? null;
  store.maySteer = state.may_steer ?? false;
  store.steerable = state.steerable ?? store.steerable;
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
  void loadTrials();
  const anotherRun = !sameRun && known !== null;
  if (anotherRun && cameraAsked.from) {
    // What was turned since stays turned.
    const { from } = cameraAsked;
    view.pose = { ...view.pose, azimuth: view.pose.azimuth - from.azimuth, elevation: view.pose.elevation - from.elevation };
    cameraAsked.from = null;
  }
  if (anotherRun || store.steps[lowerBound(view.step ?? 0)]?.step !== view.step) view.step = null;
  refresh();
}

export function connect(): void {
  const events = new EventSource("api/events");
  events.onopen = () => {
    link.phase = "live";
    void load();
    refresh();
  };
  events.addEventListener("step", (event: MessageEvent<string>) => {
    const row = JSON.parse(event.data) as StepRow;
    if (link.loading) link.arrivedWhileLoading.push(row);
    else upsert(row);
    refresh();
  });
  events.addEventListener("tuner", (event: MessageEvent<string>) => {
    store.tuner = JSON.parse(event.data) as Tuner | null;
    refresh();
  });
  events.addEventListener("steerable", (event: MessageEvent<string>) => {
    store.steerable = JSON.parse(event.data) as Steerable;
    refresh();
  });
  events.addEventListener("run", () => void load());
  events.addEventListener("trial", (event: MessageEvent<string>) => {
    Object.assign(store, { study: JSON.parse(event.data) as Study | null, studyAt: performance.now() });
    refreshStatus();
    void loadTrials();
  });
  events.onerror = () => {
    link.phase = "reconnecting";
    // The browser tries again by itself unless the answer was no event stream at all.
    if (events.readyState === EventSource.CLOSED) setTimeout(connect, RETRY_MS);
    refresh();
  };
}
