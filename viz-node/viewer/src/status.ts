// Status in words: the run, the connection, a study under way, and how far the picture is behind.

import type { Study } from "./api";
import type { Pose } from "./engine/wasm";
import { drawOverlay } from "./overlay";
import { deviceReason, deviceText } from "./picture";
import { refreshStatus } from "./frame";
import { decibelText, decibels, fixed, kilobytes } from "./plots";
import { FRONT, type Shown, QUIET_MS, byId, link, lowerBound, newest, picture, store, view } from "./state";

/** A study without a trial for longer has ended; a run's first, whose end is told by the steps, has stopped. */
const STUDY_QUIET_MS = 10_000;
const FIRST_STUDY_QUIET_MS = 60_000;
/** A picture of every step takes a moment; only one that is late for longer is said to be behind. */
const BEHIND_MS = 600;

/** Since when the picture has been behind; null: it is not. */
const behind: { since: number | null } = { since: null };

function duration(ms: number): string {
  const seconds = Math.floor(ms / 1000);
  if (seconds < 90) return `${seconds} s`;
  return seconds < 5400 ? `${Math.floor(seconds / 60)} min` : `${Math.floor(seconds / 3600)} h`;
}

export function setText(element: Element, text: string): void {
  // Writing the same words again would make a screen reader say them again.
  if (element.textContent !== text) element.textContent = text;
}

/** What became of a request, in the words that stand below its panel. */
export function drawMessage(id: string, text: string, refused: boolean): void {
  byId(id).className = refused ? "broken" : "";
  setText(byId(id), text);
}

export function drawRun() {
  const facts = [];
  if (store.run) facts.push(store.run.field, store.run.dims?.join(" × "), `${store.steps.length} steps`);
  if (store.missed > 0) facts.push(`${store.missed} missed`);
  const quiet = performance.now() - link.lastStepAt;
  if (store.run && link.phase === "live" && quiet > QUIET_MS) facts.push(`no new step for ${duration(quiet)}`);
  const [name, rest] = [...byId("run").children] as [Element, Element];
  setText(name, store.run?.name ?? "");
  setText(rest, facts.length ? facts.filter(Boolean).join(" · ") : "");
  const title = store.run ? `${store.run.name} – Lamina` : "Lamina";
  if (document.title !== title) document.title = title;
}

// ---- Study -----------------------------------------------------------------------------------------------------------

/**
 * The study under way, or null. A run's first has ended when a newer step comes with its parameters. Later ones end unseen, since
 * steps are tuned all along: they count for as long as their trials come.
 */
function currentStudy(): Study | null {
  const { study, studyAt } = store;
  if (study === null || !store.run || link.phase !== "live") return null;
  const last = newest();
  if (study.first && last !== null && last.step > study.step && last.tuning === "done") return null;
  return performance.now() - studyAt < (study.first ? FIRST_STUDY_QUIET_MS : STUDY_QUIET_MS) ? study : null;
}

function studyText() {
  const study = currentStudy();
  if (study === null) return "";
  const { trials, best_psnr_db, best_size_bytes } = study;
  const best = best_psnr_db === null ? "none keeps the limits yet" : `best so far ${decibelText(decibels(best_psnr_db))} dB, ${fixed(kilobytes(best_size_bytes), 1)} kB`;
  return `tuning: trial ${trials}, ${best}`;
}

// ---- Behind ----------------------------------------------------------------------------------------------------------

/** Steps that have come since the one on the stage, where the reader follows the newest. */
function stepsBehind() {
  if (view.step !== null || picture.shown === null) return 0;
  return store.steps.length - lowerBound(picture.shown.step + 1);
}

function behindText() {
  const steps = stepsBehind();
  if (steps === 0) {
    behind.since = null;
    return "";
  }
  if (behind.since === null) {
    behind.since = performance.now();
    setTimeout(refreshStatus, BEHIND_MS + 10);
  }
  const late = performance.now() - behind.since >= BEHIND_MS;
  return late ? `, behind by ${steps} step${steps === 1 ? "" : "s"}` : "";
}

// ---- State -----------------------------------------------------------------------------------------------------------

/** The state in a word, and on the stage what to do about it. */
function stateWords(): [string, string, string, string] {
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

export function drawState() {
  const [state, word, title, advice] = stateWords();
  byId("state").dataset.state = state;
  setText(byId("state"), word);
  // No live region: a screen reader would say every trial and every late picture.
  setText(byId("study"), studyText());
  const empty = picture.shown === null || !store.run;
  byId("picture").classList.toggle("empty", empty);
  byId("zoom").hidden = empty;
  const hint = byId("hint");
  hint.hidden = !empty || title === "";
  const [strong, span] = [...hint.children] as [Element, Element];
  setText(strong, title);
  setText(span, advice);
  const notice = state === "reconnecting" && !empty ? `${title}. ${advice}` : picture.notice;
  byId("notice").hidden = notice === "";
  setText(byId("notice"), notice);
  drawOverlay();
  byId("rendered").title = picture.shown ? deviceReason(picture.shown) : "";
  setText(byId("rendered"), picture.shown && !empty ? renderedText(picture.shown) : "");
  const { azimuth, elevation, zoom } = view.pose;
  const turned = Object.entries(view.pose).some(([name, value]) => value !== FRONT[name as keyof Pose]);
  setText(byId("camera"), turned && !empty ? `${fixed(azimuth, 0)}°, ${fixed(elevation, 0)}°, ×${fixed(zoom, 2)}` : "");
}

function renderedText(shown: Shown): string {
  const { step, size, renderMs, appearance } = shown;
  return `step ${step}${behindText()}, ${size} px in ${fixed(renderMs, 1)} ms${appearance ? ", not as recorded" : ""}, ${deviceText(shown)}`;
}
