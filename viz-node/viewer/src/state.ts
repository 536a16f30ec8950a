// What the server said, what the reader chose, and what is on the stage: everything drawn is a function of these.

import type { PageState, Run, Steerable, StepRow, Study, Tuner } from "./api";
import { FRONT, type Pose } from "./engine/wasm";

export { FRONT };

export const LARGEST_SIZE = 1024;
export const IDLE_MS = 180;
export const RETRY_MS = 2000;
export const QUIET_MS = 10_000;
export const ZOOM_RANGE: [number, number] = [0.25, 8];

/** A step of a run. */
export interface StepOf {
  run: string;
  step: number;
}

/** A picture that is asked for: `appearance` is JSON, or null for the recorded one. */
export interface Wanted {
  run: string;
  step: number;
  /** The newest step is followed. */
  live: boolean;
  pose: Pose;
  size: number;
  appearance: string | null;
  /** The step that is drawn beside it. */
  beside: StepOf | null;
  /** Drawn fast rather than well. */
  draft: boolean;
}

export interface Shown extends Wanted {
  askedAt: number;
  renderMs: number;
  by: "gpu" | "cpu" | "server";
}

interface Store {
  run: Run | null;
  limit: PageState["limit"];
  steps: StepRow[];
  trials: StepRow[];
  missed: number;
  loaded: boolean;
  study: Study | null;
  /** When it was last heard of. */
  studyAt: number;
  tuner: Tuner | null;
  /** This browser may change the contract and steer. */
  maySteer: boolean;
  steerable: Steerable;
}

export const store: Store = {
  run: null,
  limit: { size_bytes: null, time_ms: null },
  steps: [],
  trials: [],
  missed: 0,
  loaded: false,
  study: null,
  studyAt: 0,
  tuner: null,
  maySteer: false,
  steerable: { listens: false, paused: false, stopping: false, numbers: [], fields: [], shown: "", transfer: null, effects: null, triggers: null },
};

/** `step: null` follows the newest; the camera is relative to the generation camera. */
export const view: { step: number | null; pose: Pose } = { step: null, pose: FRONT };

/** The generation camera was asked to come to the view: the run that follows is seen from its front. */
export const cameraAsked: { from: Pose | null } = { from: null };

interface Link {
  phase: "connecting" | "live" | "reconnecting";
  loading: AbortController | null;
  arrivedWhileLoading: StepRow[];
  lastStepAt: number;
  trialsAsked: object;
}

export const link: Link = {
  phase: "connecting",
  loading: null,
  arrivedWhileLoading: [],
  lastStepAt: performance.now(),
  trialsAsked: {},
};

export const motion = { held: false, timer: 0 };

interface Picture {
  /** What was asked for, and what stops the asking. */
  coming: { want: Wanted; stop: AbortController } | null;
  shown: Shown | null;
  /** What the server or the step refuses. */
  refused: Wanted | null;
  retryAt: number;
  restUntil: number;
  restTimer: number;
  notice: string;
  /** No picture is asked for: a video is made. */
  resting: boolean;
}

export const picture: Picture = {
  coming: null,
  shown: null,
  refused: null,
  retryAt: 0,
  restUntil: 0,
  restTimer: 0,
  notice: "",
  resting: false,
};

export const byId = <E extends HTMLElement = HTMLElement>(id: string): E => document.getElementById(id) as E;
export const clamp = (x: number, low: number, high: number): number => Math.min(Math.max(x, low), high);
export const newest = (): StepRow | null => store.steps[store.steps.length - 1] ?? null;

/** The position of the first row whose step is at least `step`. */
export function lowerBound(step: number): number {
  let [low, high] = [0, store.steps.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (store.steps[middle]!.step < step) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Adds a row, or replaces the same step's when its PSNR has come in. */
export function upsert(row: StepRow): void {
  const at = lowerBound(row.step);
  const known = store.steps[at]?.step === row.step;
  store.steps.splice(at, known ? 1 : 0, row);
  if (!known) link.lastStepAt = performance.now();
  // Those in force are the newest step's.
  if (at === store.steps.length - 1) store.limit = { size_bytes: row.size_limit_bytes, time_ms: row.time_limit_ms };
}

export function shownIndex(): number {
  return view.step === null ? store.steps.length - 1 : lowerBound(view.step);
}

/** The row of step number `step`, if it is recorded. */
export function rowOf(step: number): StepRow | null {
  const row = store.steps[lowerBound(step)];
  return row?.step === step ? row : null;
}

export const shownRow = (): StepRow | null => store.steps[shownIndex()] ?? null;

/** The index of the step nearest to step number `step`. */
export function nearestIndex(step: number): number {
  const after = clamp(lowerBound(step), 0, store.steps.length - 1);
  const before = Math.max(after - 1, 0);
  return step - store.steps[before]!.step <= store.steps[after]!.step - step ? before : after;
}
