// Triggers: conditions over each step, and what is done where one becomes true. The generator-node has them; here they are set and removed.

import type { Trigger, TriggerAction } from "./api";
import { refresh } from "./frame";
import { post } from "./post";
import { byId, lowerBound, store } from "./state";
import { drawMessage, setText } from "./status";
import { choose } from "./steps";

const panel = { message: "", refused: false };

const actionBoxes = (): HTMLInputElement[] => [...byId("trigger-actions").querySelectorAll("input")];

async function ask(change: { set: Trigger } | { remove: string }, words: string): Promise<boolean> {
  const refusal = await post("api/trigger", change);
  Object.assign(panel, { message: refusal ?? words, refused: refusal !== null });
  refresh();
  return refusal === null;
}

/** The trigger in the form, to be changed. */
function edit({ name, when, do: actions, copy_kb, angles }: Trigger): void {
  byId<HTMLInputElement>("trigger-name").value = name;
  byId<HTMLInputElement>("trigger-when").value = when;
  actionBoxes().forEach((box) => (box.checked = actions.includes(box.value as TriggerAction)));
  if (copy_kb !== undefined) byId<HTMLInputElement>("trigger-copy").value = String(copy_kb);
  byId<HTMLInputElement>("trigger-angles").value = (angles ?? [0]).join(", ");
  byId("trigger-when").focus();
}

/** The numbers of a list with commas between them. */
function numbers(list: string): number[] {
  return list.split(",").filter((part) => part.trim() !== "").map(Number);
}

/** The newest step at which a trigger fired, and at how many it did. */
function firings(name: string): { count: number; last: number | null } {
  const fired = store.steps.filter(({ triggers }) => triggers.includes(name));
  return { count: fired.length, last: fired.at(-1)?.step ?? null };
}

function button(text: string, label: string, act: () => void): HTMLButtonElement {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = text;
  made.setAttribute("aria-label", label);
  made.addEventListener("click", act);
  return made;
}

function entry(trigger: Trigger): HTMLElement {
  const { name, when, do: actions, copy_kb, angles } = trigger;
  const [item, title, condition, tools] = [
    document.createElement("li"),
    document.createElement("b"),
    document.createElement("code"),
    document.createElement("span"),
  ];
  title.textContent = name;
  condition.textContent = when;
  tools.className = "tools";
  const fired = button("", "", () => {
    const { last } = firings(name);
    if (last !== null) choose(lowerBound(last));
  });
  fired.className = "fired";
  const change = button("Change", `Change trigger ${name}`, () => edit(trigger));
  const remove = button("Remove", `Remove trigger ${name}`, () => void ask({ remove: name }, `removed ${name}`));
  tools.append(fired, change, remove);
  const details: Partial<Record<TriggerAction, string>> = { copy: ` of at most ${copy_kb} kB`, picture: angles ? ` from ${angles.join(", ")}°` : "" };
  const done = actions.map((action) => `${action}${details[action] ?? ""}`);
  item.append(title, ` ${done.join(", ") || "record"} when `, condition, tools);
  return item;
}

export function drawTriggers(): void {
  const { triggers } = store.steerable;
  byId("triggers").hidden = triggers === null;
  if (triggers === null) return;
  setText(byId("trigger-count"), triggers.length > 0 ? String(triggers.length) : "");
  const list = byId("trigger-list");
  const shown = JSON.stringify(triggers);
  if (list.dataset.shown !== shown) {
    list.dataset.shown = shown;
    list.replaceChildren(...triggers.map(entry));
  }
  triggers.forEach(({ name }, i) => {
    const [fired, ...changes] = list.children[i]!.querySelectorAll("button");
    const { count, last } = firings(name);
    setText(fired!, count === 0 ? "not fired" : count === 1 ? `step ${last}` : `${count} times, last at step ${last}`);
    fired!.setAttribute("aria-label", count === 0 ? `${name} has not fired` : `${name} fired, show step ${last}`);
    fired!.disabled = count === 0;
    changes.forEach((change) => (change.disabled = !store.maySteer));
  });
  [...byId("trigger-form").querySelectorAll("input, button")].forEach((control) => {
    (control as HTMLInputElement | HTMLButtonElement).disabled = !store.maySteer;
  });
  drawMessage("trigger-message", panel.message || (store.maySteer ? "" : "This browser may watch only."), panel.refused);
}

export function listenToTriggers(): void {
  byId("trigger-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const [name, when] = ["trigger-name", "trigger-when"].map((id) => byId<HTMLInputElement>(id).value.trim());
    const actions = actionBoxes().filter((box) => box.checked);
    const trigger: Trigger = { name: name!, when: when!, do: actions.map((box) => box.value as TriggerAction) };
    if (trigger.do.includes("copy")) trigger.copy_kb = Math.round(byId<HTMLInputElement>("trigger-copy").valueAsNumber);
    if (trigger.do.includes("picture")) trigger.angles = numbers(byId<HTMLInputElement>("trigger-angles").value);
    void ask({ set: trigger }, `${name} looks at the steps from the next one on`).then((done) => {
      if (done) byId<HTMLFormElement>("trigger-form").reset();
    });
  });
}
