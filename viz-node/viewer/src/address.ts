// The view in the page's address, so that it can be shared, kept and gone back to: #step=12&azimuth=30&zoom=2. Colors and effects that
// were chosen for a volume follow as `look`.

import { takeAppearance, wishedAppearance } from "./appearance";
import { jumpTo } from "./camera";
import type { Pose } from "./engine/wasm";
import { refresh } from "./frame";
import { FRONT, view } from "./state";

const NAMES = Object.keys(FRONT) as (keyof Pose)[];

/** What was written or read last: another one in the address has not been read yet. */
let written = location.hash;

/** Takes the view from the address; what it does not name is as recorded. */
function read(): void {
  const stated = new URLSearchParams(location.hash.slice(1));
  const pose = { ...FRONT };
  for (const name of NAMES) {
    const value = Number(stated.get(name) ?? NaN);
    if (Number.isFinite(value)) pose[name] = value;
  }
  const step = Number(stated.get("step") ?? NaN);
  view.step = Number.isInteger(step) ? step : null;
  takeAppearance(stated.get("look"));
  jumpTo(pose);
}

/** Writes the view, once it is still. */
export function writeAddress(): void {
  if (location.hash !== written) return;
  const stated = new URLSearchParams();
  if (view.step !== null) stated.set("step", String(view.step));
  for (const name of NAMES) {
    if (view.pose[name] !== FRONT[name]) stated.set(name, String(Number(view.pose[name].toFixed(4))));
  }
  const look = wishedAppearance();
  if (look !== null) stated.set("look", look);
  const hash = stated.size === 0 ? "" : `#${stated}`;
  if (hash === written) return;
  written = hash;
  history.replaceState(null, "", hash === "" ? location.pathname + location.search : hash);
}

export function listenToAddress(): void {
  if (location.hash !== "") read();
  window.addEventListener("hashchange", () => {
    if (location.hash === written) return;
    written = location.hash;
    read();
    refresh();
  });
}
