// Drawing once a frame. Any change calls `refresh`, so a burst of steps costs one drawing. The camera is the exception: it moves
// with every frame and changes the picture and the status only (`pumpSoon`, `refreshStatus`).

import { writeAddress } from "./address";
import { drawColors } from "./colors";
import { drawComparison } from "./compare";
import { drawContract } from "./contract";
import { drawEffects } from "./effects";
import { drawField } from "./field";
import { drawGenerationCamera } from "./generation_camera";
import { drawPareto } from "./pareto";
import { pumpPicture } from "./picture";
import { PLOTS, drawAccuracy, drawPlot, drawTimeline } from "./plots";
import { drawReadout } from "./readout";
import { byId, motion, shownIndex, store, view } from "./state";
import { drawRun, drawState } from "./status";
import { drawSlices } from "./slices";
import { drawSteering } from "./steering";
import { drawTriggers } from "./triggers";
import { drawTrust } from "./trust";

/** `everything`: more than the status changed since the last frame. */
const frame = { id: 0, everything: false };

function onFrame(): void {
  const { everything } = frame;
  Object.assign(frame, { id: 0, everything: false });
  if (everything) {
    // First, so that the picture is drawn while this page does the rest.
    pumpPicture();
    draw();
  } else {
    drawState();
  }
  drawGenerationCamera();
}

export function refreshStatus(): void {
  frame.id ||= requestAnimationFrame(onFrame);
}

export function refresh(): void {
  frame.everything = true;
  refreshStatus();
}

function draw(): void {
  drawState();
  drawRun();
  drawTransport();
  drawTimeline();
  drawReadout();
  drawColors();
  drawEffects();
  drawComparison();
  PLOTS.forEach(drawPlot);
  drawAccuracy();
  drawTrust();
  drawPareto();
  drawContract();
  drawField();
  drawSteering();
  drawTriggers();
  drawSlices();
  if (store.loaded && !motion.held && !motion.timer) writeAddress();
}

function drawTransport(): void {
  const index = shownIndex();
  byId("live").setAttribute("aria-pressed", String(view.step === null));
  byId<HTMLButtonElement>("previous").disabled = index <= 0;
  byId<HTMLButtonElement>("next").disabled = index >= store.steps.length - 1;
}
