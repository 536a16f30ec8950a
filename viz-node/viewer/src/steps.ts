// The choice of a step.

import { refresh } from "./frame";
import { clamp, store, view } from "./state";

export function choose(index: number): void {
  const row = store.steps[clamp(index, 0, store.steps.length - 1)];
  if (!row) return;
  view.step = row.step;
  refresh();
}

export function followNewest(): void {
  view.step = null;
  refresh();
}
