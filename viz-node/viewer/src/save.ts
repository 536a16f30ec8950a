// What is on the page as a file.

import { byId, picture, store } from "./state";

/** Of the run's name, `what` and an extension. */
export function fileName(what: string, extension: string): string {
  return `${(store.run?.name ?? "run").replaceAll(/[^\w.-]+/g, "_")}_${what}.${extension}`;
}

export function download(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}

/** The picture on the stage as a PNG file. */
export function savePicture(): void {
  const { shown } = picture;
  if (!shown) return;
  byId<HTMLCanvasElement>("picture").toBlob((blob) => {
    if (blob) download(blob, fileName(`step_${shown.step}`, "png"));
  }, "image/png");
}
