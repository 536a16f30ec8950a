// The picture on the stage as a PNG file.

import { byId, picture, store } from "./state";

export function savePicture(): void {
  const { shown } = picture;
  if (!shown) return;
  byId<HTMLCanvasElement>("picture").toBlob((blob) => {
    if (!blob) return;
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = `${(store.run?.name ?? "run").replaceAll(/[^\w.-]+/g, "_")}_step_${shown.step}.png`;
    link.click();
    URL.revokeObjectURL(link.href);
  }, "image/png");
}
