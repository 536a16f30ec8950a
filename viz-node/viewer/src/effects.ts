// Light, surfaces and clipping: of a volume, chosen on the page in place of the recorded ones; of a VDI, to be asked for.

import { moving } from "./camera";
import { drawClip, listenToClip, statedBox, takeBox } from "./clip";
import type { Description, Effects, Isosurface, RecordedCamera } from "./engine/wasm";
import { refresh } from "./frame";
import { keepHistory, mayRedo, mayUndo, redo, remember, undo } from "./history";
import { painter, shownDescription } from "./picture";
import { significant } from "./plots";
import { axesOf } from "./projection";
import { fromHex, hex } from "./rgb";
import { type Asked, askToShow, drawAsked } from "./show";
import { byId, clamp, motion, shownRow, store } from "./state";
import { setText } from "./status";
import { classified, positionOf, valueAt } from "./transfer";
import { type Vector, add, dot, scaled, unit } from "./vector";

/**
 * Of run `run`: its first volume's description, and what is wished in place of its effects; null: as recorded.
 * Where VDIs are shown: that of one with what the generator-node draws with, of which `stated` has the effects as JSON.
 */
interface Chosen {
  run: string | null;
  description: Description | null;
  wished: Effects | null;
  stated: string | null;
}

const chosen: Chosen = { run: null, description: null, wished: null, stated: null };

const asked: Asked = { message: "", refused: false };

const MOST_SURFACES = 4;
/** Beside the end of a part that was not recorded, in shares of the range. */
const MARGIN = 1e-4;
const SHADING = { ambient: 0.4, diffuse: 0.6, specular: 0.2, shininess: 32 };
/** Of the light where the scene has none: from the left and above. */
const LIGHT: [number, number] = [-30, 40];

/** Effects of a link, until it is known what was recorded. */
const linked: { effects: Effects | null } = { effects: null };

/** Effects to draw the shown step with, or none: as recorded, or not a volume. */
export function wishedEffects(): Effects | null {
  if (shownRow()?.representation !== "volume") return null;
  return chosen.run === store.run?.id ? (chosen.stated === null ? chosen.wished : null) : linked.effects;
}

/** Draws with the effects of a link; null: with those that were recorded. */
export function takeEffects(effects: Effects | null): void {
  if (chosen.run !== null && chosen.run === store.run?.id && chosen.stated === null) put(effects);
  else linked.effects = effects;
}

const input = (id: string) => byId<HTMLInputElement>(id);

const radians = (degrees: number) => (degrees * Math.PI) / 180;

/** Towards a light so many degrees to the right of and above the recorded camera. */
export function lightFrom(camera: RecordedCamera, azimuth: number, elevation: number): Vector {
  const { back, right, up } = axesOf(camera);
  const level = Math.cos(radians(elevation));
  const sideways = add(scaled(back, level * Math.cos(radians(azimuth))), scaled(right, level * Math.sin(radians(azimuth))));
  return add(sideways, scaled(up, Math.sin(radians(elevation))));
}

/** How many degrees a light stands to the right of and above the recorded camera. */
export function anglesOf(camera: RecordedCamera, light: Vector): [number, number] {
  const { back, right, up } = axesOf(camera);
  const towards = unit(light);
  const degrees = (angle: number) => (angle * 180) / Math.PI;
  return [degrees(Math.atan2(dot(towards, right), dot(towards, back))), degrees(Math.asin(clamp(dot(towards, up), -1, 1)))];
}

// ---- Panel -----------------------------------------------------------------------------------------------------------

/** Parts of the range that touch each other as one. */
function merged(parts: [number, number][]): [number, number][] {
  const whole: [number, number][] = [];
  for (const [lo, hi] of parts) {
    const last = whole[whole.length - 1];
    if (last && lo - last[1] < 2 * MARGIN) last[1] = Math.max(last[1], hi);
    else whole.push([lo, hi]);
  }
  return whole;
}

/** The nearest position whose value was recorded. */
function recordedPlace(at: number, unrecorded: [number, number][]): number {
  for (const [lo, hi] of merged(unrecorded)) {
    const [below, above] = [lo - MARGIN, hi + MARGIN];
    if (at <= below || at >= above) continue;
    return (at - lo < hi - at && below > 0) || above > 1 ? below : above;
  }
  return at;
}

function surfaceRow(surface: Isosurface, at: number): HTMLElement {
  const row = document.createElement("div");
  row.className = "surface";
  row.innerHTML = `<input type="color" aria-label="Color of the surface" value="${hex(surface.color)}">
    <label>Value <output></output> <input type="range" class="value" min="0" max="1" step="0.002" value="${at}"></label>
    <label>Opacity <input type="range" class="opacity" min="0.05" max="1" step="0.05" value="${surface.opacity}"></label>
    <button type="button" aria-label="Remove the surface" title="Remove">&#215;</button>`;
  row.querySelector("button")!.addEventListener("click", () => {
    row.remove();
    change();
  });
  return row;
}

function addSurface(): void {
  const { description } = chosen;
  if (!description?.transfer) return;
  // Half way up what was recorded.
  const { range, points } = description.transfer;
  const at = recordedPlace(0.5, description.unrecorded);
  const color = classified(points, at).color as Vector;
  byId("surfaces").append(surfaceRow({ value: valueAt(range, at), color, opacity: 0.8 }, at));
  change();
}

/** What the panel says. */
function stated(description: Description): Effects {
  const { range } = description.transfer!;
  const { clip_planes, depth_cue, pre_integrated } = description.effects ?? {};
  const [shadows, occlusion] = [Number(input("shadows").value), Number(input("occlusion").value)];
  const shading = input("shading").checked ? { shading: description.effects?.shading ?? SHADING } : {};
  const lit = input("shading").checked || shadows > 0;
  const isosurfaces = [...byId("surfaces").children].map((row) => {
    const at = recordedPlace(Number(row.querySelector<HTMLInputElement>(".value")!.value), description.unrecorded);
    setText(row.querySelector("output")!, significant(valueAt(range, at), 3));
    const opacity = Number(row.querySelector<HTMLInputElement>(".opacity")!.value);
    return { value: valueAt(range, at), color: fromHex(row.querySelector<HTMLInputElement>("[type=color]")!.value), opacity };
  });
  return {
    ...(clip_planes && { clip_planes }),
    ...(depth_cue && { depth_cue }),
    ...(pre_integrated && { pre_integrated }),
    ...(lit && { light: lightFrom(description.camera, Number(input("light-azimuth").value), Number(input("light-elevation").value)) }),
    ...shading,
    ...(shadows > 0 && { shadows }),
    ...(occlusion > 0 && { ambient_occlusion: occlusion }),
    ...(isosurfaces.length > 0 && { isosurfaces }),
    ...statedBox(description.bounds),
  };
}

/** Brings the panel to these effects; null: to the recorded ones. */
function showEffects(description: Description, wished: Effects | null): void {
  const effects = wished ?? description.effects ?? {};
  input("shading").checked = effects.shading !== undefined;
  input("shadows").value = String(effects.shadows ?? 0);
  input("occlusion").value = String(effects.ambient_occlusion ?? 0);
  const [azimuth, elevation] = effects.light ? anglesOf(description.camera, effects.light) : LIGHT;
  input("light-azimuth").value = String(azimuth);
  input("light-elevation").value = String(elevation);
  const { range } = description.transfer!;
  byId("surfaces").replaceChildren(...(effects.isosurfaces ?? []).map((s) => surfaceRow(s, positionOf(range, s.value))));
  takeBox(description.bounds, effects.clip_box ?? null);
  stated(description);
}

/** Draws with what the panel says. */
function change(continues = false): void {
  const { description } = chosen;
  if (!description) return;
  remember(continues);
  draw(stated(description));
}

function backToRecorded(): void {
  remember(false);
  put(null);
}

/** Puts `wished` in the place of what is drawn and of what the panel says. */
function put(wished: Effects | null): void {
  if (chosen.description) showEffects(chosen.description, wished);
  draw(wished);
}

/** The camera's drafts serve here too. */
function draw(wished: Effects | null): void {
  chosen.wished = wished;
  asked.message = "";
  moving();
  refresh();
}

/** Takes a volume's recorded effects, once a run. */
function takeRecorded(description: Description): void {
  if (chosen.run === store.run?.id && chosen.stated === null) return;
  Object.assign(chosen, { run: store.run!.id, description, wished: linked.effects, stated: null });
  linked.effects = null;
  showEffects(description, chosen.wished);
}

/** Takes those that VDIs are generated with, whenever they change. A run whose volumes were seen keeps what is chosen for these. */
function takeStated(vdi: Description): void {
  const { transfer, effects } = store.steerable;
  const stated = JSON.stringify(effects);
  if (chosen.run === store.run?.id && (chosen.stated === null || chosen.stated === stated)) return;
  const description = { ...vdi, transfer, effects };
  Object.assign(chosen, { run: store.run!.id, description, wished: null, stated });
  showEffects(description, null);
}

export function drawEffects(): void {
  const details = byId<HTMLDetailsElement>("effects");
  const row = shownRow();
  const isVolume = row?.representation === "volume";
  const mayAsk = store.maySteer && store.steerable.transfer !== null && store.steerable.effects !== null;
  details.hidden = painter === null || !row || !(isVolume || mayAsk);
  const description = shownDescription();
  if (!details.hidden && description) {
    if (isVolume && description.transfer) takeRecorded(description);
    else if (!isVolume && !description.transfer) takeStated(description);
  }
  const known = chosen.run === store.run?.id && chosen.description !== null && isVolume === (chosen.stated === null);
  drawClip(!details.hidden && details.open && known);
  byId<HTMLButtonElement>("add-surface").disabled = !known || byId("surfaces").childElementCount >= MOST_SURFACES;
  byId<HTMLButtonElement>("recorded-effects").disabled = chosen.wished === null;
  byId<HTMLButtonElement>("undo-effects").disabled = !mayUndo();
  byId<HTMLButtonElement>("redo-effects").disabled = !mayRedo();
  const ask = byId<HTMLButtonElement>("ask-effects");
  ask.hidden = !mayAsk;
  ask.disabled = !known || chosen.wished === null;
  drawAsked("effects-message", asked);
}

export function listenToEffects(): void {
  const details = byId("effects");
  details.addEventListener("toggle", refresh);
  details.addEventListener("input", () => change(true));
  // Drafts until the control is let go, wherever.
  let slides = false;
  details.addEventListener("pointerdown", ({ target }) => {
    if ((target as Element).matches("[type=range]")) slides = motion.held = true;
  });
  const release = () => {
    if (!slides) return;
    slides = motion.held = false;
    refresh();
  };
  window.addEventListener("pointerup", release);
  window.addEventListener("pointercancel", release);
  byId("add-surface").addEventListener("click", addSurface);
  byId("ask-effects").addEventListener("click", () => void askToShow({ effects: chosen.wished }, asked));
  byId("recorded-effects").addEventListener("click", backToRecorded);
  byId("undo-effects").addEventListener("click", undo);
  byId("redo-effects").addEventListener("click", redo);
  keepHistory({ get: () => chosen.wished, put });
  listenToClip(() => change(true));
}
