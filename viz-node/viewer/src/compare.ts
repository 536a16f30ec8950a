// A step beside another from the same view: its picture, or how far the two differ. The other is a step of the run that stays, or that of
// another recorded run at the same time of the simulation.

import type { Run, RunSteps } from "./api";
import { refresh } from "./frame";
import type { Picture } from "./engine/painter";
import { fixed, significant } from "./plots";
import { type StepOf, byId, shownRow, store } from "./state";
import { setText } from "./status";

interface Comparison {
  /** A step that the shown one is compared with. */
  step: StepOf | null;
  /** Another run, whose step nearest in time the shown one is compared with. */
  run: RunSteps | null;
  difference: boolean;
  /** The other step's picture that belongs to the one on the stage. */
  other: { step: number; pixels: ImageData } | null;
  /** The other runs recorded here, and the run they are other than. */
  known: { runs: Run[]; beside: string | null };
}

const comparison: Comparison = { step: null, run: null, difference: false, other: null, known: { runs: [], beside: null } };

/** Differences are a few of 255: so many times brighter they are seen. */
const GAIN = 4;

/** The step that is drawn beside the shown one, which is of time `time`. */
export function stepBeside(time: number): StepOf | null {
  const { run } = comparison;
  if (run === null) return comparison.step;
  const nearest = run.steps.reduce((a, b) => (Math.abs(b.time - time) < Math.abs(a.time - time) ? b : a));
  return { run: run.run.id, step: nearest.step };
}

const isOn = () => comparison.step !== null || comparison.run !== null;

/** Beside the step that is shown now; then their difference; then none. */
export function nextComparison(): void {
  const row = shownRow();
  if (!row || !store.run) return;
  if (!isOn()) Object.assign(comparison, { step: { run: store.run.id, step: row.step }, difference: false });
  else if (!comparison.difference) comparison.difference = true;
  else Object.assign(comparison, { step: null, run: null, difference: false });
  paint();
  refresh();
}

/** Beside the run `id`; none if it is empty. */
async function compareWithRun(id: string): Promise<void> {
  const answer = id === "" ? null : await fetch(`api/runs/${encodeURIComponent(id)}`, { cache: "no-store" }).catch(() => null);
  const run = answer?.ok ? ((await answer.json()) as RunSteps) : null;
  const empty = id !== "" && !run?.steps.length;
  setText(byId("other-run-message"), empty ? "It has no step that can be read." : "");
  Object.assign(comparison, { step: null, run: empty ? null : run, difference: false, other: null });
  refresh();
}

/** Asks which other runs there are, once a run. */
async function learnRuns(): Promise<void> {
  const beside = store.run?.id ?? null;
  if (comparison.known.beside === beside) return;
  comparison.known = { runs: [], beside };
  const answer = await fetch("api/runs", { cache: "no-store" }).catch(() => null);
  if (!answer?.ok) return;
  comparison.known.runs = (await answer.json()) as Run[];
  refresh();
}

/** When it began, as its id says, and what it is. */
function nameOf({ id, name, field, dims }: Run): string {
  const micros = Number(id.slice(id.lastIndexOf("-") + 1));
  const began = micros > 1e15 ? new Date(micros / 1000).toLocaleString() : id;
  return `${name} ${field}, ${dims.join(" × ")}, ${began}`;
}

export function drawComparison(): void {
  void learnRuns();
  // Another run has begun.
  if (comparison.step !== null && comparison.step.run !== store.run?.id) Object.assign(comparison, { step: null, difference: false });
  if (comparison.run !== null && comparison.run.run.id === store.run?.id) Object.assign(comparison, { run: null, difference: false });
  if (!isOn()) comparison.other = null;
  byId("stage").toggleAttribute("data-compares", isOn());
  byId("beside").hidden = byId("compared").hidden = !isOn();
  byId("compare").setAttribute("aria-pressed", String(isOn()));
  byId("runs").hidden = comparison.known.runs.length === 0;
  const choice = byId<HTMLSelectElement>("other-run");
  const ids = comparison.known.runs.map(({ id }) => id).join("\n");
  if (choice.dataset.ids !== ids) {
    choice.dataset.ids = ids;
    choice.replaceChildren(new Option("None", ""), ...comparison.known.runs.map((run) => new Option(nameOf(run), run.id)));
  }
  if (document.activeElement !== choice) choice.value = comparison.run?.run.id ?? "";
}

export function listenToComparison(): void {
  const choice = byId<HTMLSelectElement>("other-run");
  choice.addEventListener("change", () => void compareWithRun(choice.value));
}

/** Takes the other step's picture, which belongs to the one that has just been shown. */
export function showBeside({ step, bitmap }: Picture): void {
  const canvas = byId<HTMLCanvasElement>("beside");
  [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
  const context = canvas.getContext("2d", { willReadFrequently: true })!;
  context.drawImage(bitmap, 0, 0);
  comparison.other = { step, pixels: context.getImageData(0, 0, canvas.width, canvas.height) };
  paint();
}

/** The other step in words. */
function otherText(step: number): string {
  const { run } = comparison;
  const time = run?.steps.find((known) => known.step === step)?.time;
  return time === undefined ? `step ${step}` : `${run!.run.name}, the other run, step ${step}, time ${significant(time, 4)}`;
}

/** Shows the other step's picture, or how far it is from the one on the stage. */
function paint(): void {
  if (comparison.other === null) return;
  const [shown, canvas] = [byId<HTMLCanvasElement>("picture"), byId<HTMLCanvasElement>("beside")];
  const { step, pixels: other } = comparison.other;
  const painted = new ImageData(new Uint8ClampedArray(other.data), other.width, other.height);
  const own = shown.getContext("2d", { willReadFrequently: true })!.getImageData(0, 0, canvas.width, canvas.height);
  let squares = 0;
  for (let n = 0; n < other.data.length; n++) {
    const apart = Math.abs(own.data[n]! - other.data[n]!);
    squares += apart * apart;
    if (comparison.difference && n % 4 !== 3) painted.data[n] = GAIN * apart;
  }
  canvas.getContext("2d")!.putImageData(painted, 0, 0);
  canvas.dataset.step = String(step);
  const mean = squares / ((3 * other.data.length) / 4) / 255 ** 2;
  const decibels = mean === 0 ? "equal" : `${fixed(-10 * Math.log10(mean), 1)} dB apart`;
  const name = otherText(step);
  setText(byId("compared"), comparison.difference ? `difference from ${name}, ${GAIN} times: ${decibels}` : `${name}: ${decibels}`);
}
