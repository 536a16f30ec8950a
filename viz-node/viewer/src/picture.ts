// The picture on the stage: which one is wanted, and who draws it.

import { wishedAppearance } from "./appearance";
import { showBeside, stepBeside } from "./compare";
import { DraftSize } from "./draft_size";
import { BrowserPainter, type Picture, Refused } from "./engine/painter";
import type { Description } from "./engine/wasm";
import { refresh, refreshStatus } from "./frame";
import { serverPicture } from "./server_picture";
import { LARGEST_SIZE, RETRY_MS, type Shown, type StepOf, type Wanted, byId, clamp, link, motion, picture, rowOf, shownRow, store, view } from "./state";

const draftSize = new DraftSize();

/** Null where the browser cannot draw at all: then the server does. */
export const painter = browserPainter();
let serverDraws = painter === null;

function browserPainter(): BrowserPainter | null {
  // `?cpu`, `?webgpu`, `?webgl` and `?server` choose for themselves: to compare, and where a GPU draws wrongly.
  const asked = new URLSearchParams(location.search);
  if (asked.has("server")) return null;
  if (typeof WebAssembly !== "object" || typeof OffscreenCanvas !== "function") return null;
  const worker = new Worker(new URL("./engine/worker.ts", import.meta.url), { type: "module", name: ["cpu", "webgpu", "webgl"].find((name) => asked.has(name)) ?? "" });
  const before = (run: string, step: number) => (run === store.run?.id ? (rowOf(step)?.after_step ?? null) : null);
  return new BrowserPainter(worker, before, refreshStatus, () => {
    serverDraws = true;
    refresh();
  });
}

const DRAWN_BY = { gpu: "by this machine's GPU", cpu: "by this machine's processor", server: "by the viz-node" };

/** What is known of the step on the stage, where the browser holds it. */
export const shownDescription = (): Description | null => (picture.shown && painter?.description(picture.shown.run, picture.shown.step)) ?? null;

/** What drew the picture on the stage, in words. */
export const deviceText = ({ by }: Shown): string => DRAWN_BY[by];

/** Which GPU, or why there is none. */
export function deviceReason({ by }: Shown): string {
  const device = painter?.device;
  if (device?.kind !== by) return "";
  return device.kind === "cpu" ? device.why : `${device.api}: ${device.name}`;
}

function fullSize(): number {
  const side = byId("picture").clientWidth * (window.devicePixelRatio || 1);
  return clamp(Math.round(side), 64, LARGEST_SIZE);
}

/** A still of a step that the next one is about to follow should take no longer. */
const BRIEF_STILL_MS = 300;
/** Steps that come no more often than this leave time for a whole still. */
const STEADY_MS = 2000;
const LEAST_STILL = 256;
/** A draft comes before a still that takes longer. */
const SLOW_STILL_MS = 500;

/** Milliseconds a pixel that the last still took; 0: not known. */
let stillCost = 0;

/** Whether the newest step is followed, and steps keep coming. */
const follows = () => view.step === null && performance.now() - link.lastStepAt < STEADY_MS;

function stillSize(): number {
  const full = fullSize();
  if (!follows() || stillCost === 0) return full;
  return clamp(Math.round(Math.sqrt(BRIEF_STILL_MS / stillCost)), Math.min(LEAST_STILL, full), full);
}

const same = (a: StepOf | null, b: StepOf | null) => a?.run === b?.run && a?.step === b?.step;

const inMotion = () => Boolean(motion.held || motion.timer);

function wantedPicture(): Wanted | null {
  const row = shownRow();
  if (!row || !store.run) return null;
  const [appearance, beside] = [wishedAppearance(), stepBeside(row.time)];
  const { shown } = picture;
  const other = shown === null || shown.step !== row.step || shown.appearance !== appearance || !same(shown.beside, beside);
  // An empty stage is filled by a draft first, and one that shows something else where a still takes its time.
  const draft = inMotion() || shown === null || (other && !follows() && stillCost * fullSize() ** 2 > SLOW_STILL_MS);
  return {
    run: store.run.id,
    step: row.step,
    live: view.step === null,
    pose: view.pose,
    size: draft ? Math.min(draftSize.side, fullSize()) : stillSize(),
    appearance,
    beside,
    draft,
  };
}

/**
 * Whether picture `have` is what `want` asks for, as well drawn or better. The newest picture may be of a step whose event has not
 * come yet; asking again would only bring it once more. The size of a draft does not matter: it is whatever was affordable.
 */
function satisfies(have: Wanted | null, want: Wanted): boolean {
  if (have === null) return false;
  const sameStep = have.step === want.step || (want.live && have.step > want.step);
  const sameView = have.run === want.run && have.appearance === want.appearance && have.pose === want.pose && same(have.beside, want.beside);
  // The cost of a still is never quite the last one's: the same step is not drawn again for a few more pixels.
  const large = have.size >= (follows() ? 0.7 : 1) * want.size;
  return sameStep && sameView && (!have.draft || want.draft) && (want.draft || large);
}

let pumpQueued = false;

/** Pumps after the running event handler: the camera may change more than once in it. */
export function pumpSoon(): void {
  if (pumpQueued) return;
  pumpQueued = true;
  queueMicrotask(() => {
    pumpQueued = false;
    pumpPicture();
  });
}

/**
 * Asks for the wanted picture unless one is on its way; whatever is wanted when that one lands comes next. Only motion does not
 * wait for a still.
 */
export function pumpPicture(): void {
  if (picture.resting) return;
  const want = wantedPicture();
  if (picture.coming) {
    const serves = want === null || [picture.shown, picture.coming.want].some((have) => satisfies(have, want));
    if (want?.draft && !picture.coming.want.draft && !serves) picture.coming.stop.abort();
    return;
  }
  // A step that is held can be turned without the server.
  const reachable = link.phase === "live" || (painter !== null && picture.shown !== null);
  if (!want || !reachable || performance.now() < picture.retryAt) return showBusy();
  if (satisfies(picture.refused, want)) return showBusy();
  if (satisfies(picture.shown, want)) {
    // Back from a step that had no picture to the one still on the stage.
    if (picture.notice) refresh();
    picture.notice = "";
    return showBusy();
  }
  const rest = want.draft ? 0 : picture.restUntil - performance.now();
  if (rest > 0) {
    showBusy();
    clearTimeout(picture.restTimer);
    picture.restTimer = setTimeout(pumpPicture, rest);
    return;
  }
  void bringPicture(want);
}

/** Gets and shows a picture. */
async function bringPicture(want: Wanted): Promise<void> {
  const askedAt = performance.now();
  const stop = new AbortController();
  picture.coming = { want, stop };
  showBusy();
  try {
    const drawn = await drawnPicture(want, stop.signal);
    const beside = drawn && want.beside !== null ? await drawnPicture({ ...want, ...want.beside, live: false }, stop.signal) : null;
    if (drawn && (beside || want.beside === null)) {
      // A new run may have begun meanwhile, and this picture would pass for its step.
      if (want.run === store.run?.id) {
        showPicture(drawn, { ...want, step: drawn.step, askedAt, renderMs: drawn.drawMs, by: drawn.by });
        if (beside) showBeside(beside);
      }
      drawn.bitmap.close();
      beside?.bitmap.close();
      if (!want.draft) stillCost = drawn.drawMs / want.size ** 2;
      if (want.draft && inMotion()) draftSize.record(want.size, performance.now() - askedAt);
    }
  } catch (error) {
    if (!stop.signal.aborted) failed(want, error);
  }
  picture.coming = null;
  pumpPicture();
  showBusy();
}

/** A picture, by whoever draws here; null if another took its place. */
export async function drawnPicture(want: Wanted, signal: AbortSignal): Promise<Picture | null> {
  if (painter === null || serverDraws) return serverPicture(want, signal);
  return painter.draw(want.run, want.step, want.pose, want.size, !want.draft, want.appearance, signal);
}

function failed(want: Wanted, error: unknown): void {
  picture.notice = `No picture of step ${want.step}: ${error instanceof Error ? error.message : String(error)}`;
  // What is unknown or refused stays so; a fault of the server's may pass.
  if (error instanceof Refused) picture.refused = { ...want, size: Infinity, draft: false };
  else retryPicture();
  refresh();
}

function retryPicture(): void {
  picture.retryAt = performance.now() + RETRY_MS;
  setTimeout(refresh, RETRY_MS + 10);
}

function showPicture({ bitmap, by }: Picture, shown: Shown): void {
  const canvas = byId<HTMLCanvasElement>("picture");
  // Setting the size, even to what it is, makes the browser allocate the canvas again.
  if (canvas.width !== bitmap.width) canvas.width = bitmap.width;
  if (canvas.height !== bitmap.height) canvas.height = bitmap.height;
  const context = canvas.getContext("2d", { willReadFrequently: true })!;
  context.drawImage(bitmap, 0, 0);
  const first = picture.shown === null;
  if (first || !shown.draft) continueBackground(context, bitmap.width, bitmap.height);
  const { step, size, draft, renderMs, pose, appearance } = shown;
  const facts = { step, size, draft, renderMs, drawnBy: by, appearance: appearance ?? "", decodeMs: painter?.decodeMs ?? "", decoders: painter?.decoders ?? "" };
  for (const [name, value] of Object.entries(facts)) canvas.dataset[name] = String(value);
  for (const [name, value] of Object.entries(pose)) canvas.dataset[name] = String(Number(value.toFixed(4)));
  // A still takes half of the time at most: a simulation may need the same processor.
  const restUntil = draft ? picture.restUntil : performance.now() + (renderMs || 0);
  Object.assign(picture, { shown, refused: null, retryAt: 0, restUntil, notice: "" });
  refreshStatus();
  // What is known of the step came with it.
  if (first || !shown.draft) refresh();
}

/** Says while pictures are on their way, without a break between the drafts of one motion. */
function showBusy(): void {
  const stage = byId("stage");
  const busy = picture.coming !== null;
  if (busy === stage.hasAttribute("aria-busy")) return;
  if (busy) stage.setAttribute("aria-busy", "true");
  else stage.removeAttribute("aria-busy");
}

/** The stage takes the picture's background, if its corners agree on one, so that the square does not look cut out. */
function continueBackground(context: CanvasRenderingContext2D, width: number, height: number): void {
  const corners = [0, height - 1].flatMap((y) => [0, width - 1].map((x) => context.getImageData(x, y, 1, 1).data.join()));
  if (new Set(corners).size === 1) byId("stage").style.background = `rgb(${corners[0]!.split(",", 3).join(" ")})`;
}
