// Steering: pause, go on, stop, and the numbers that the simulation offers.

import type { SteerableNumber } from "./api";
import { refresh } from "./frame";
import { post } from "./post";
import { byId, store } from "./state";
import { drawMessage, setText } from "./status";

const panel: { message: string; refused: boolean; stopAsked: boolean } = { message: "", refused: false, stopAsked: false };

type Request = "pause" | "resume" | "stop" | { set: { name: string; value: number } };

async function ask(request: Request, words: string): Promise<void> {
  const refusal = await post("api/steer", request);
  Object.assign(panel, { message: refusal ?? words, refused: refusal !== null, stopAsked: false });
  refresh();
}

function askForNumber(name: string, field: HTMLInputElement): void {
  const value = Number(field.value);
  if (field.value.trim() === "" || !Number.isFinite(value)) {
    Object.assign(panel, { message: `${name}: not a number`, refused: true });
    refresh();
    return;
  }
  void ask({ set: { name, value } }, `asked for ${name} = ${value}`);
}

/** A field for each number, kept while the numbers have the same names, so that the focus stays. */
function drawNumbers(numbers: SteerableNumber[]): void {
  const box = byId("numbers");
  const names = numbers.map(({ name }) => name).join("\n");
  if (box.dataset.names !== names) {
    box.dataset.names = names;
    box.replaceChildren(...numbers.map(numberField));
  }
  [...box.querySelectorAll("input")].forEach((field, i) => {
    const { value, least, most } = numbers[i]!;
    field.title = `${least} to ${most}`;
    field.disabled = !store.maySteer;
    // What was asked for since it was typed.
    if (document.activeElement !== field && field.dataset.value !== String(value)) {
      field.value = field.dataset.value = String(value);
    }
  });
}

function numberField({ name }: SteerableNumber): HTMLElement {
  const [label, field] = [document.createElement("label"), document.createElement("input")];
  field.inputMode = "decimal";
  field.autocomplete = "off";
  field.name = name;
  field.addEventListener("change", () => askForNumber(name, field));
  label.append(`${name} `, field);
  return label;
}

export function drawSteering(): void {
  const { listens, paused, stopping, numbers } = store.steerable;
  byId("steering").hidden = !listens;
  if (!listens) return;
  const pause = byId<HTMLButtonElement>("pause");
  setText(pause, paused ? "Go on" : "Pause");
  pause.setAttribute("aria-pressed", String(paused));
  pause.disabled = !store.maySteer || stopping;
  const stop = byId<HTMLButtonElement>("stop");
  // Twice: a stopped simulation cannot be called back.
  setText(stop, panel.stopAsked ? "Stop for good" : "Stop");
  stop.disabled = !store.maySteer || stopping;
  drawNumbers(numbers);
  const state = stopping ? "asked to stop" : paused ? "asked to pause" : store.maySteer ? "" : "This browser may watch only.";
  drawMessage("steering-message", panel.message || state, panel.refused);
}

export function listenToSteering(): void {
  byId("pause").addEventListener("click", () => {
    const { paused } = store.steerable;
    void ask(paused ? "resume" : "pause", "");
  });
  const stop = byId("stop");
  stop.addEventListener("click", () => {
    if (panel.stopAsked) void ask("stop", "");
    panel.stopAsked = true;
    refresh();
  });
  stop.addEventListener("blur", () => {
    panel.stopAsked = false;
    refresh();
  });
}
