// The viewer: listens, connects, draws.

import "./viewer.css";
import { listenToAddress } from "./address";
import { listenToPicture, onKey, resetCamera, zoomBy } from "./camera";
import { listenToColors } from "./colors";
import { listenToComparison, nextComparison } from "./compare";
import { listenToContract } from "./contract";
import { listenToEffects } from "./effects";
import { listenToField } from "./field";
import { refresh, refreshStatus } from "./frame";
import { followView, listenToGenerationCamera } from "./generation_camera";
import { toggleFlight } from "./fly";
import { openHelp } from "./help";
import { listenToHistory } from "./history";
import { toggleOverlay } from "./overlay";
import { listenToPareto } from "./pareto";
import { listenToPlay } from "./play";
import { savePicture } from "./save";
import { GUTTER, PLOTS, listenToSteps } from "./plots";
import { pumpSoon } from "./picture";
import { connect } from "./server";
import { byId, shownIndex } from "./state";
import { drawRun } from "./status";
import { listenToSlices } from "./slices";
import { listenToSteering } from "./steering";
import { listenToTriggers } from "./triggers";
import { listenToVideo } from "./video";
import { choose, followNewest } from "./steps";

function buildFigures(): void {
  const build = (id: string, label: string, role = "img") => {
    byId(id).innerHTML = `<figcaption><span></span><span></span></figcaption>
      <div class="plot"><svg role="${role}" aria-label="${label}"></svg></div>`;
  };
  build("trust", "PSNR over the angle between the view and the generation camera");
  // Its points can be pressed.
  build("pareto", "PSNR over size, trials of the newest study", "group");
  listenToPareto();
  build("accuracy", "PSNR over generation time, all steps and trials");
  for (const { id, label } of PLOTS) {
    build(id, `${label} over steps`);
    listenToSteps(byId(id).querySelector<HTMLElement>(".plot")!, GUTTER, 8);
  }
}

function onClick(id: string, action: () => void): void {
  byId(id).addEventListener("click", action);
}

buildFigures();
listenToPicture(byId<HTMLCanvasElement>("picture"));
listenToSteps(byId("timeline"), 10, 10);
listenToColors();
listenToEffects();
listenToHistory();
listenToComparison();
listenToContract();
listenToField();
listenToGenerationCamera();
listenToSteering();
listenToTriggers();
listenToSlices();
document.addEventListener("keydown", onKey);
onClick("previous", () => choose(shownIndex() - 1));
onClick("next", () => choose(shownIndex() + 1));
onClick("live", followNewest);
onClick("zoom-in", () => zoomBy(1.25));
onClick("zoom-out", () => zoomBy(1 / 1.25));
onClick("reset", resetCamera);
onClick("fly", toggleFlight);
onClick("box", toggleOverlay);
onClick("save", savePicture);
onClick("compare", nextComparison);
onClick("help", openHelp);
listenToPlay();
listenToVideo();
new ResizeObserver(refresh).observe(byId("stage"));
new ResizeObserver(refresh).observe(document.querySelector("aside")!);
setInterval(() => {
  drawRun();
  refreshStatus();
  followView();
  // A run that has come to rest is drawn whole.
  pumpSoon();
}, 1000);
listenToAddress();
connect();
refresh();
