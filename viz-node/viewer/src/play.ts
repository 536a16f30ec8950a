// Playing the recorded steps: one after the other, at a speed, again from the first if asked to.

import { refresh } from "./frame";
import { painter } from "./picture";
import { byId, picture, shownIndex, store, view } from "./state";
import { choose } from "./steps";

/** Steps a second. */
const SPEEDS = [1, 2, 5, 10, 25];
/** Steps fetched ahead of the one that is shown. */
const AHEAD = 2;

const play = { timer: 0, speed: 1, loop: false };

export const isPlaying = (): boolean => play.timer !== 0;

function stop(): void {
  clearInterval(play.timer);
  play.timer = 0;
  drawPlay();
  refresh();
}

function next(): void {
  // No faster than steps are drawn.
  if (picture.coming) return;
  const index = shownIndex();
  const last = store.steps.length - 1;
  if (index >= last && !play.loop) return stop();
  choose(index >= last ? 0 : index + 1);
  for (let ahead = 1; ahead <= AHEAD && store.run; ahead++) {
    const row = store.steps[shownIndex() + ahead];
    // What cannot be had is said when its turn comes.
    if (row) void painter?.hold(store.run.id, row.step).catch(() => undefined);
  }
}

export function togglePlay(): void {
  if (isPlaying()) return stop();
  if (shownIndex() >= store.steps.length - 1) choose(0);
  else if (view.step === null) choose(shownIndex());
  play.timer = setInterval(next, 1000 / SPEEDS[play.speed]!);
  drawPlay();
}

function drawPlay(): void {
  const button = byId("play");
  button.setAttribute("aria-pressed", String(isPlaying()));
  button.textContent = isPlaying() ? "❚❚" : "▶";
  byId("speed").textContent = `${SPEEDS[play.speed]}/s`;
  byId("loop").setAttribute("aria-pressed", String(play.loop));
}

export function listenToPlay(): void {
  byId("play").addEventListener("click", togglePlay);
  byId("speed").addEventListener("click", () => {
    play.speed = (play.speed + 1) % SPEEDS.length;
    if (isPlaying()) {
      clearInterval(play.timer);
      play.timer = setInterval(next, 1000 / SPEEDS[play.speed]!);
    }
    drawPlay();
  });
  byId("loop").addEventListener("click", () => {
    play.loop = !play.loop;
    drawPlay();
  });
  // Whoever takes a step by hand wants to stay there.
  for (const id of ["timeline", "previous", "next", "live"]) {
    byId(id).addEventListener("pointerdown", () => isPlaying() && stop());
  }
  drawPlay();
}
