// The picture on the stage: which one is wanted, how it is fetched and shown.
"use strict";

function fullSize() {
  const side = byId("picture").clientWidth * (window.devicePixelRatio || 1);
  return clamp(Math.round(side), 64, LARGEST_SIZE);
}

function wantedPicture() {
  const row = shownRow();
  if (!row || !store.run) return null;
  const { azimuth, elevation, zoom } = view;
  const draft = Boolean(motion.held || motion.timer);
  const size = draft ? DRAFT_SIZE : fullSize();
  const points = wishedPoints();
  return { run: store.run.id, step: row.step, live: view.step === null, azimuth, elevation, zoom, size, points, draft };
}

/**
 * Whether picture `have` is what `want` asks for, as large and as well drawn, or better. The newest picture may be of a step whose
 * event has not come yet; asking again would only bring it once more.
 */
function satisfies(have, want) {
  if (have === null) return false;
  const sameStep = have.step === want.step || (want.live && have.step > want.step);
  const sameView = ["run", "azimuth", "elevation", "zoom", "points"].every((key) => have[key] === want[key]);
  return sameStep && sameView && have.size >= want.size && have.draft <= want.draft;
}

/**
 * Asks for the wanted picture unless one is on its way; whatever is wanted when that one lands comes next. Only hands that move do
 * not wait for a picture that is drawn well.
 */
async function pumpPicture() {
  const want = wantedPicture();
  if (picture.coming) {
    const serves = want === null || [picture.shown, picture.coming.want].some((have) => satisfies(have, want));
    if (want?.draft && !picture.coming.want.draft && !serves) picture.coming.stop.abort();
    return;
  }
  if (!want || link.phase !== "live" || performance.now() < picture.retryAt) return;
  if (satisfies(picture.refused, want)) return;
  if (satisfies(picture.shown, want)) {
    // Back from a step that had no picture to the one still on the stage.
    if (picture.notice) refresh();
    picture.notice = "";
    return;
  }
  const rest = want.draft ? 0 : picture.restUntil - performance.now();
  if (rest > 0) {
    setTimeout(refresh, rest);
    return;
  }
  picture.coming = { want, stop: new AbortController() };
  byId("stage").setAttribute("aria-busy", "true");
  try {
    await fetchPicture(want, picture.coming.stop.signal);
  } catch {
    if (!picture.coming.stop.signal.aborted) retryPicture();
  }
  picture.coming = null;
  byId("stage").removeAttribute("aria-busy");
  refresh();
}

async function fetchPicture(want, signal) {
  const query = new URLSearchParams({
    // Colours are those of the step they were chosen for, or one like it: the newest may be a VDI.
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
    // What is unknown or refused stays so; a fault of the server's may pass.
    if (answer.status < 500) picture.refused = { ...want, size: Infinity, draft: false };
    else retryPicture();
    return;
  }
  const bitmap = await createImageBitmap(await answer.blob());
  // A new run may have begun meanwhile, and this picture would pass for its step.
  if (want.run === store.run?.id) showPicture(bitmap, want, answer.headers);
  bitmap.close();
}

function retryPicture() {
  picture.retryAt = performance.now() + RETRY_MS;
  setTimeout(refresh, RETRY_MS + 10);
}

function showPicture(bitmap, want, headers) {
  const step = Number(headers.get("X-Lamina-Step") ?? want.step);
  const renderMs = Number(headers.get("X-Lamina-Render-Ms") ?? NaN);
  const canvas = byId("picture");
  [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  continueBackground(context, bitmap.width, bitmap.height);
  Object.assign(canvas.dataset, { step, size: want.size, renderMs });
  for (const key of ["azimuth", "elevation", "zoom"]) canvas.dataset[key] = Number(want[key].toFixed(4));
  // What is drawn well takes half of the time at most: a simulation may need the same processor.
  const restUntil = want.draft ? picture.restUntil : performance.now() + (renderMs || 0);
  Object.assign(picture, { shown: { ...want, step }, refused: null, retryAt: 0, restUntil, notice: "" });
  byId("rendered").textContent = `step ${step}, ${want.size} px in ${fixed(renderMs, 1)} ms${want.points ? ", own colours" : ""}`;
}

/** The stage takes the picture's background, if its corners agree on one, so that the square does not look cut out. */
function continueBackground(context, width, height) {
  const corners = [[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]];
  const [first, ...others] = corners.map(([x, y]) => context.getImageData(x, y, 1, 1).data.join());
  if (others.every((other) => other === first)) byId("stage").style.background = `rgb(${first.split(",", 3).join(" ")})`;
}
