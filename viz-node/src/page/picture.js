// The picture on the stage: which one is wanted, how it is fetched and shown.
"use strict";

const draftSize = new DraftSize();

function fullSize() {
  const side = byId("picture").clientWidth * (window.devicePixelRatio || 1);
  return clamp(Math.round(side), 64, LARGEST_SIZE);
}

const inMotion = () => Boolean(motion.held || motion.timer);

function wantedPicture() {
  const row = shownRow();
  if (!row || !store.run) return null;
  const { azimuth, elevation, zoom } = view;
  // An empty stage is filled by a draft first.
  const draft = inMotion() || picture.shown === null;
  const size = draft ? draftSize.side : fullSize();
  const points = wishedPoints();
  return { run: store.run.id, step: row.step, live: view.step === null, azimuth, elevation, zoom, size, points, draft };
}

/**
 * Whether picture `have` is what `want` asks for, as well drawn or better. The newest picture may be of a step whose event has not
 * come yet; asking again would only bring it once more. The size of a draft does not matter: it is whatever was affordable.
 */
function satisfies(have, want) {
  if (have === null) return false;
  const sameStep = have.step === want.step || (want.live && have.step > want.step);
  const sameView = ["run", "azimuth", "elevation", "zoom", "points"].every((key) => have[key] === want[key]);
  return sameStep && sameView && have.draft <= want.draft && (want.draft || have.size >= want.size);
}

let pumpQueued = false;

/** Pumps after the running event handler: the camera may change more than once in it. */
function pumpSoon() {
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
function pumpPicture() {
  const want = wantedPicture();
  if (picture.coming) {
    const serves = want === null || [picture.shown, picture.decoding, picture.coming.want].some((have) => satisfies(have, want));
    if (want?.draft && !picture.coming.want.draft && !serves) picture.coming.stop.abort();
    return;
  }
  if (!want || link.phase !== "live" || performance.now() < picture.retryAt) return showBusy();
  if (satisfies(picture.refused, want)) return showBusy();
  if (satisfies(picture.decoding, want)) return;
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
  bringPicture(want);
}

/** Fetches and shows a picture. The next one is asked for while this one is decoded. */
async function bringPicture(want) {
  const askedAt = performance.now();
  const stop = new AbortController();
  picture.coming = { want, stop };
  showBusy();
  let received = null;
  try {
    received = await receivePicture(want, stop.signal);
  } catch {
    if (!stop.signal.aborted) retryPicture();
  }
  picture.coming = null;
  if (received) picture.decoding = { ...want, step: received.step };
  const decoding = picture.decoding;
  pumpPicture();
  if (received) {
    try {
      const bitmap = await createImageBitmap(received.blob);
      // A new run may have begun meanwhile, and this picture would pass for its step.
      const overtaken = picture.shown?.askedAt > askedAt;
      if (want.run === store.run?.id && !overtaken) showPicture(bitmap, { ...want, askedAt }, received);
      bitmap.close();
      if (want.draft && inMotion()) draftSize.record(want.size, performance.now() - askedAt);
    } catch {
      retryPicture();
    }
    if (picture.decoding === decoding) picture.decoding = null;
  }
  pumpPicture();
  showBusy();
}

/** The picture's bytes and what the server says of them; nothing where it refuses. */
async function receivePicture(want, signal) {
  const query = new URLSearchParams({
    // Colors are those of the step they were chosen for, or one like it: the newest may be a VDI.
    step: want.live && !want.points ? "newest" : want.step,
    azimuth: want.azimuth.toFixed(2),
    elevation: want.elevation.toFixed(2),
    zoom: want.zoom.toFixed(4),
    size: want.size,
    draft: want.draft,
    ...(want.points && { points: JSON.stringify(want.points, (_, x) => (typeof x === "number" ? Number(x.toPrecision(6)) : x)) }),
  });
  const answer = await fetch(`api/image?${query}`, { cache: "no-store", signal });
  if (!answer.ok) {
    picture.notice = `No picture of step ${want.step}: ${(await answer.text()).trim() || answer.status}`;
    refresh();
    // What is unknown or refused stays so; a fault of the server's may pass.
    if (answer.status < 500) picture.refused = { ...want, size: Infinity, draft: false };
    else retryPicture();
    return null;
  }
  const step = Number(answer.headers.get("X-Lamina-Step") ?? want.step);
  const renderMs = Number(answer.headers.get("X-Lamina-Render-Ms") ?? NaN);
  return { step, renderMs, blob: await answer.blob() };
}

function retryPicture() {
  picture.retryAt = performance.now() + RETRY_MS;
  setTimeout(refresh, RETRY_MS + 10);
}

function showPicture(bitmap, want, { step, renderMs }) {
  const canvas = byId("picture");
  // Setting the size, even to what it is, makes the browser allocate the canvas again.
  if (canvas.width !== bitmap.width) canvas.width = bitmap.width;
  if (canvas.height !== bitmap.height) canvas.height = bitmap.height;
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  const first = picture.shown === null;
  if (first || !want.draft) continueBackground(context, bitmap.width, bitmap.height);
  Object.assign(canvas.dataset, { step, size: want.size, draft: want.draft, renderMs });
  for (const key of ["azimuth", "elevation", "zoom"]) canvas.dataset[key] = Number(want[key].toFixed(4));
  // A still takes half of the time at most: a simulation may need the same processor.
  const restUntil = want.draft ? picture.restUntil : performance.now() + (renderMs || 0);
  Object.assign(picture, { shown: { ...want, step, renderMs }, refused: null, retryAt: 0, restUntil, notice: "" });
  refreshStatus();
}

/** Says while pictures are on their way, without a break between the drafts of one motion. */
function showBusy() {
  const stage = byId("stage");
  const busy = Boolean(picture.coming || picture.decoding);
  if (busy === stage.hasAttribute("aria-busy")) return;
  if (busy) stage.setAttribute("aria-busy", "true");
  else stage.removeAttribute("aria-busy");
}

/** The stage takes the picture's background, if its corners agree on one, so that the square does not look cut out. */
function continueBackground(context, width, height) {
  const corners = [[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]];
  const [first, ...others] = corners.map(([x, y]) => context.getImageData(x, y, 1, 1).data.join());
  if (others.every((other) => other === first)) byId("stage").style.background = `rgb(${first.split(",", 3).join(" ")})`;
}
