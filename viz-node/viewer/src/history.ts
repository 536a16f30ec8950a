// What was chosen before, in colors and effects alike, so that it can be taken back.

import { store } from "./state";

/** A part of the page whose choice is kept: what it is now, and how another one is taken. A choice is never changed in place. */
interface Part {
  get: () => unknown;
  put: (choice: never) => void;
}

/** The choice of every part, in the order of `parts`. */
type Choices = unknown[];

const parts: Part[] = [];
/** Of run `run`: the choices before each change, the newest last, and those that were taken back. */
const kept: { run: string | null; past: Choices[]; undone: Choices[]; changedAt: number } = { run: null, past: [], undone: [], changedAt: 0 };
const ONE_CHANGE_MS = 400;
const MOST_PAST = 100;

const now = (): Choices => parts.map(({ get }) => get());

export function keepHistory(part: Part): void {
  parts.push(part);
}

/** Keeps what is about to change. `continues`: a hand that moves a control makes many changes, which are one where they follow soon. */
export function remember(continues: boolean): void {
  const run = store.run?.id ?? null;
  if (kept.run !== run) Object.assign(kept, { run, past: [], undone: [], changedAt: 0 });
  const time = performance.now();
  if (!continues || time - kept.changedAt > ONE_CHANGE_MS) kept.past.push(now());
  if (kept.past.length > MOST_PAST) kept.past.shift();
  kept.undone = [];
  kept.changedAt = continues ? time : 0;
}

/** Back to the choices before the last change, or forth again. */
function travel(from: Choices[], to: Choices[]): void {
  const choices = isOfRun() ? from.pop() : undefined;
  if (!choices) return;
  const before = now();
  to.push(before);
  kept.changedAt = 0;
  parts.forEach(({ put }, n) => choices[n] !== before[n] && put(choices[n] as never));
}

const isOfRun = (): boolean => kept.run === (store.run?.id ?? null);

export const undo = (): void => travel(kept.past, kept.undone);
export const redo = (): void => travel(kept.undone, kept.past);
export const mayUndo = (): boolean => isOfRun() && kept.past.length > 0;
export const mayRedo = (): boolean => isOfRun() && kept.undone.length > 0;

/** The keys that everybody tries; in a text field they are the field's own. */
export function listenToHistory(): void {
  document.addEventListener("keydown", (event) => {
    const isText = document.activeElement?.matches("input:not([type=checkbox]):not([type=color]):not([type=range])");
    if (!(event.ctrlKey || event.metaKey) || isText) return;
    const action = { z: event.shiftKey ? redo : undo, y: redo }[event.key.toLowerCase()];
    if (!action) return;
    event.preventDefault();
    action();
  });
}
