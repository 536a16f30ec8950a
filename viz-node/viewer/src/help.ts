// The sheet of keys and gestures.

import { byId } from "./state";

export function openHelp(): void {
  byId<HTMLDialogElement>("help-sheet").showModal();
}
