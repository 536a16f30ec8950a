// What is shown of the run's fields: one of them, or an expression, computed by the generator-node from the next step on.

import { refresh } from "./frame";
import { post } from "./post";
import { byId, store } from "./state";
import { drawMessage, setText } from "./status";

/** What was typed and is not asked for yet; null: the line shows what is asked for. */
const draft: { text: string | null; message: string; refused: boolean } = { text: null, message: "", refused: false };

/** Names that an expression reads as they are. */
const isPlain = (name: string): boolean => /^[\p{L}_][\p{L}\p{N}_.:]*$/u.test(name);

/** Fields, and what is often asked of vectors and scalars. */
function suggestions(fields: string[]): string[] {
  const vectors = fields.filter((name) => name.endsWith(".x")).map((name) => name.slice(0, -2));
  const isVector = (name: string) => ["x", "y", "z"].every((axis) => fields.includes(`${name}.${axis}`));
  const of = (name: string) => (isPlain(name) ? name : `"${name}"`);
  const derived = vectors
    .filter(isVector)
    .flatMap((v) => [`magnitude(${of(v)})`, `magnitude(curl(${of(v)}))`, `divergence(${of(v)})`, `lambda2(${of(v)})`, `q_criterion(${of(v)})`]);
  const scalars = fields.filter((name) => !vectors.some((v) => isVector(v) && [".x", ".y", ".z"].some((axis) => name === v + axis)));
  return [...fields, ...derived, ...scalars.map((name) => `magnitude(gradient(${of(name)}))`)];
}

async function show(field: string): Promise<void> {
  const refusal = await post("api/show", { field });
  Object.assign(draft, { text: refusal === null ? null : field, message: refusal ?? "from the next step on", refused: refusal !== null });
  refresh();
}

export function drawField(): void {
  const { fields, shown } = store.steerable;
  byId("fields").hidden = fields.length === 0;
  if (fields.length === 0) return;
  setText(byId("field-shown"), shown);
  const choice = byId<HTMLSelectElement>("field-choice");
  const all = suggestions(fields);
  if (choice.dataset.names !== all.join("\n")) {
    choice.dataset.names = all.join("\n");
    choice.replaceChildren(...["", ...all].map((text) => new Option(text || "Choose", text)));
  }
  const line = byId<HTMLInputElement>("field-line");
  const text = draft.text ?? shown;
  if (line.value !== text && (document.activeElement !== line || draft.text === null)) line.value = text;
  if (document.activeElement !== choice) choice.value = all.includes(shown) ? shown : "";
  [choice, line].forEach((control) => (control.disabled = !store.maySteer));
  byId<HTMLButtonElement>("field-ask").disabled = !store.maySteer || text.trim() === "" || text === shown;
  const arrived = draft.message !== "" && !draft.refused && store.run?.field === shown;
  drawMessage("field-message", arrived ? "" : draft.message || (store.maySteer ? "" : "This browser may watch only."), draft.refused);
}

export function listenToField(): void {
  const [choice, line] = [byId<HTMLSelectElement>("field-choice"), byId<HTMLInputElement>("field-line")];
  choice.addEventListener("change", () => choice.value !== "" && void show(choice.value));
  line.addEventListener("input", () => {
    Object.assign(draft, { text: line.value, message: "", refused: false });
    refresh();
  });
  byId("field-form").addEventListener("submit", (event) => {
    event.preventDefault();
    void show(line.value.trim());
  });
}
