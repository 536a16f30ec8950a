// A video of a turn around the shown step, or of the recorded steps from the chosen view: drawn picture by picture, then recorded
// while they are played in the time they stand for.

import { wishedAppearance } from "./appearance";
import { drawnPicture, pumpSoon } from "./picture";
import { download, fileName } from "./save";
import { type Wanted, byId, clamp, picture, shownRow, store, view } from "./state";
import { setText } from "./status";

const FRAMES_A_SECOND = 24;
/** All pictures together, pixels of four bytes. */
const MOST_PIXELS = 1 << 26;
/** The first that the browser can write. */
const FORMATS = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"];

const making: { stop: AbortController | null } = { stop: null };

const number = (id: string) => Number(byId<HTMLInputElement>(id).value);
const wholeTurn = () => byId<HTMLSelectElement>("video-of").value === "turn";
const say = (text: string) => setText(byId("video-message"), text);

/** What is to be seen, picture by picture, and how many of them a second. */
function script(side: number, seconds: number): { frames: Wanted[]; rate: number } {
  const row = shownRow()!;
  const frame = { run: store.run!.id, step: row.step, live: false, pose: view.pose, size: side, appearance: wishedAppearance(), draft: false, beside: null };
  if (wholeTurn()) {
    const count = Math.max(Math.round(FRAMES_A_SECOND * seconds), 2);
    const turn = (n: number) => ({ ...view.pose, azimuth: view.pose.azimuth + (360 * n) / count });
    return { frames: Array.from({ length: count }, (_, n) => ({ ...frame, pose: turn(n) })), rate: FRAMES_A_SECOND };
  }
  return { frames: store.steps.map(({ step }) => ({ ...frame, step })), rate: store.steps.length / seconds };
}

/** All pictures; null if that was given up. */
async function drawAll(frames: Wanted[], signal: AbortSignal): Promise<ImageBitmap[] | null> {
  const drawn: ImageBitmap[] = [];
  for (const frame of frames) {
    say(`picture ${drawn.length + 1} of ${frames.length}`);
    // Null: another picture, that had been asked for before, took its place.
    let one = null;
    while (one === null && !signal.aborted) one = await drawnPicture(frame, signal);
    if (one === null) {
      drawn.forEach((bitmap) => bitmap.close());
      return null;
    }
    drawn.push(one.bitmap);
  }
  return drawn;
}

async function record(drawn: ImageBitmap[], rate: number): Promise<Blob> {
  const mimeType = FORMATS.find((format) => MediaRecorder.isTypeSupported(format));
  if (!mimeType) throw new Error("this browser records no video");
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [drawn[0]!.width, drawn[0]!.height];
  const context = canvas.getContext("2d")!;
  const stream = canvas.captureStream(0);
  const track = stream.getVideoTracks()[0] as CanvasCaptureMediaStreamTrack;
  const recorder = new MediaRecorder(stream, { mimeType, videoBitsPerSecond: 4 * canvas.width * canvas.height });
  const parts: Blob[] = [];
  recorder.ondataavailable = ({ data }) => parts.push(data);
  const ended = new Promise<void>((resolve, reject) => {
    recorder.onstop = () => resolve();
    recorder.onerror = () => reject(new Error("the browser could not record it"));
  });
  const show = (bitmap: ImageBitmap) => {
    context.drawImage(bitmap, 0, 0);
    track.requestFrame();
  };
  recorder.start();
  const begun = performance.now();
  for (const [n, bitmap] of drawn.entries()) {
    show(bitmap);
    const wait = begun + (1000 * (n + 1)) / rate - performance.now();
    await new Promise((resolve) => setTimeout(resolve, Math.max(wait, 0)));
  }
  // The last picture stands until then.
  show(drawn[drawn.length - 1]!);
  recorder.stop();
  await ended;
  return new Blob(parts, { type: mimeType });
}

async function make(): Promise<void> {
  const row = shownRow();
  if (!row || !store.run || making.stop) return;
  const seconds = clamp(number("video-seconds") || 6, 0.5, 60);
  const asked = clamp(Math.round(number("video-side")) || 512, 64, 2048);
  const count = script(asked, seconds).frames.length;
  // Even: what video codecs ask for.
  const side = 2 * Math.floor(Math.min(asked, Math.sqrt(MOST_PIXELS / count)) / 2);
  const { frames, rate } = script(side, seconds);
  const stop = (making.stop = new AbortController());
  picture.resting = true;
  picture.coming?.stop.abort();
  try {
    const drawn = await drawAll(frames, stop.signal);
    if (drawn) {
      say("recording");
      const video = await record(drawn, rate);
      drawn.forEach((bitmap) => bitmap.close());
      download(video, fileName(wholeTurn() ? `step_${row.step}_turn` : "steps", video.type.startsWith("video/mp4") ? "mp4" : "webm"));
      say(`${frames.length} pictures of ${side} x ${side}, ${(video.size / 1000).toFixed(0)} kB`);
    } else say("given up");
  } catch (error) {
    say(error instanceof Error ? error.message : String(error));
  }
  making.stop = null;
  picture.resting = false;
  pumpSoon();
}

export function listenToVideo(): void {
  byId("video").addEventListener("click", () => byId<HTMLDialogElement>("video-sheet").showModal());
  byId("video-make").addEventListener("click", () => void make());
  byId("video-sheet").addEventListener("close", () => making.stop?.abort());
}
