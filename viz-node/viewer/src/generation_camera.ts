// The camera that VDIs are generated from: brought to the view, by hand or where that rests far from it.

import { refresh } from "./frame";
import { post } from "./post";
import { byId, cameraAsked, picture, shownRow, store, view } from "./state";
import { viewAngle } from "./trust";

/** Farther from where a VDI was generated, more of it is missing than a picture hides. */
const CONE_DEG = 30;
/** The view has to rest for so long before the generation camera follows it by itself. */
const REST_MS = 1500;

const follow: { restingSince: number; at: string } = { restingSince: 0, at: "" };

async function generateFromHere(): Promise<void> {
  const row = shownRow();
  if (!row || cameraAsked.from) return;
  const { azimuth, elevation } = (cameraAsked.from = view.pose);
  const refusal = await post("api/show", { view: { step: row.step, azimuth, elevation } });
  if (refusal !== null) {
    cameraAsked.from = null;
    byId<HTMLInputElement>("follow-view").checked = false;
  }
  picture.notice = refusal ?? "";
  refresh();
}

/** Lets the generation camera follow a view that rests outside of the cone, where that is wanted. */
export function followView(): void {
  const at = JSON.stringify(view.pose);
  if (at !== follow.at) Object.assign(follow, { at, restingSince: performance.now() });
  const wanted = byId<HTMLInputElement>("follow-view").checked && store.maySteer && view.step === null;
  const rests = performance.now() - follow.restingSince > REST_MS;
  if (wanted && rests && shownRow()?.representation === "vdi" && viewAngle(view.pose) > CONE_DEG) void generateFromHere();
}

export function drawGenerationCamera(): void {
  const button = byId<HTMLButtonElement>("generate-here");
  button.hidden = shownRow()?.representation !== "vdi" || !store.maySteer || viewAngle(view.pose) < 1;
  button.disabled = cameraAsked.from !== null;
  byId("follow-view").closest("label")!.hidden = !store.maySteer;
}

export function listenToGenerationCamera(): void {
  byId("generate-here").addEventListener("click", () => void generateFromHere());
}
