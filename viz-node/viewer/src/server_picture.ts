// Pictures that the server draws, for browsers that cannot.

import { type Picture, Refused } from "./engine/painter";
import { type Wanted, store } from "./state";

export async function serverPicture(want: Wanted, signal: AbortSignal): Promise<Picture> {
  if (want.run !== store.run?.id) throw new Refused("the viz-node draws the current run's steps only");
  const { azimuth, elevation, zoom } = want.pose;
  const query = new URLSearchParams({
    // An appearance is for the step it was chosen for, or one like it: the newest may be a VDI.
    step: want.live && !want.appearance ? "newest" : String(want.step),
    azimuth: azimuth.toFixed(2),
    elevation: elevation.toFixed(2),
    zoom: zoom.toFixed(4),
    size: String(want.size),
    draft: String(want.draft),
    ...(want.appearance && { appearance: want.appearance }),
  });
  const answer = await fetch(`api/image?${query}`, { cache: "no-store", signal });
  if (!answer.ok) {
    const reason = (await answer.text()).trim() || String(answer.status);
    throw answer.status < 500 ? new Refused(reason) : new Error(reason);
  }
  const step = Number(answer.headers.get("X-Lamina-Step") ?? want.step);
  const drawMs = Number(answer.headers.get("X-Lamina-Render-Ms") ?? NaN);
  return { step, drawMs, by: "server", bitmap: await createImageBitmap(await answer.blob()) };
}
