// The contract: what is in force, and the fields and the line in which another is asked for.

import { fixed, kilobytes } from "./plots";
import { refresh } from "./frame";
import { post } from "./post";
import { byId, store } from "./state";
import { drawMessage, setText } from "./status";

/** A limit that has a field: its part of the contract, in the field's unit. */
interface Limit {
  id: string;
  name: string;
  sign: "<=" | ">=";
  unit: string;
}

const LIMITS: Limit[] = [
  { id: "limit-size", name: "size", sign: "<=", unit: "kB" },
  { id: "limit-time", name: "time", sign: "<=", unit: "ms" },
  { id: "limit-psnr", name: "psnr", sign: ">=", unit: "dB" },
  { id: "limit-overhead", name: "overhead", sign: "<=", unit: "%" },
];
/** Bytes in a unit of size. */
const BYTES: Record<string, number> = { B: 1, kB: 1e3, MB: 1e6, GB: 1e9 };

/** What was typed and is not asked for yet; null: the line shows what is in force. */
const draft: { text: string | null; message: string; refused: boolean; asking: boolean } = {
  text: null,
  message: "",
  refused: false,
  asking: false,
};

const parts = (text: string): string[] => text.split(",").map((part) => part.trim()).filter(Boolean);
const isOf = ({ name, sign }: Limit, part: string): boolean => part.startsWith(name) && part.slice(name.length).trim().startsWith(sign);

/** A limit's number in its field's unit; empty where it is not limited. */
function limitValue(text: string, limit: Limit): string {
  const part = parts(text).find((one) => isOf(limit, one));
  const [, number, unit] = /([0-9.eE+-]+)\s*([a-zA-Z%]*)$/.exec(part ?? "") ?? [];
  if (number === undefined) return "";
  const factor = limit.unit === "kB" ? (BYTES[unit || "B"] ?? NaN) / 1e3 : 1;
  const value = Number(number) * factor;
  return Number.isFinite(value) ? String(Number(value.toPrecision(12))) : "";
}

/** The contract with another value of one limit; an empty value takes the limit away. */
function withLimit(text: string, limit: Limit, value: string): string {
  const part = value === "" ? [] : [`${limit.name} ${limit.sign} ${value}${limit.unit}`];
  const all = parts(text);
  const at = all.findIndex((one) => isOf(limit, one));
  // New limits come first: what is best among what keeps them stands at the end.
  if (at < 0) return [...part, ...all].join(", ");
  return [...all.slice(0, at), ...part, ...all.slice(at + 1)].join(", ");
}

const current = (): string => draft.text ?? store.tuner?.contract ?? "";

function edit(text: string | null): void {
  Object.assign(draft, { text, message: "", refused: false });
  refresh();
}

async function ask(text: string): Promise<void> {
  Object.assign(draft, { text, message: "asked", refused: false, asking: true });
  refresh();
  const refusal = await post("api/contract", { contract: text });
  draft.asking = false;
  if (refusal === null) Object.assign(draft, { text: null, message: "in force" });
  else Object.assign(draft, { message: refusal, refused: true });
  refresh();
}

/** Asks for the best quality within so many bytes; other limits stay. */
export function askForSize(bytes: number): void {
  byId<HTMLDetailsElement>("contract").open = true;
  void ask(withLimit(store.tuner?.contract ?? "", LIMITS[0]!, fixed(kilobytes(bytes), 1)));
}

export const mayAsk = (): boolean => store.maySteer && store.tuner !== null;

/** What the tuner is doing, in words. */
function tunerText(): string {
  const { tuner } = store;
  if (tuner === null) return "No tuner follows this page: the contract cannot be changed.";
  if (!store.maySteer) return "This browser may watch only.";
  if (tuner.last_error) return `Last study: ${tuner.last_error}`;
  const studies = `${tuner.studies} ${tuner.studies === 1 ? "study" : "studies"}`;
  return tuner.busy ? `Measuring; ${studies} so far` : `${studies} so far`;
}

export function drawContract(): void {
  const text = current();
  setText(byId("contract-in-force"), store.tuner?.contract ?? "unknown");
  const line = byId<HTMLInputElement>("contract-line");
  if (line.value !== text && (document.activeElement !== line || draft.text === null)) line.value = text;
  for (const limit of LIMITS) {
    const field = byId<HTMLInputElement>(limit.id);
    field.disabled = !mayAsk();
    if (document.activeElement !== field) field.value = limitValue(text, limit);
  }
  line.disabled = !mayAsk();
  const changed = draft.text !== null && draft.text !== store.tuner?.contract;
  byId<HTMLButtonElement>("contract-ask").disabled = !mayAsk() || draft.asking || !changed;
  byId<HTMLButtonElement>("contract-undo").disabled = draft.text === null || draft.asking;
  drawMessage("contract-message", draft.message || tunerText(), draft.refused);
}

export function listenToContract(): void {
  for (const limit of LIMITS) {
    const field = byId<HTMLInputElement>(limit.id);
    field.addEventListener("input", () => edit(withLimit(current(), limit, field.value.trim())));
  }
  const line = byId<HTMLInputElement>("contract-line");
  line.addEventListener("input", () => edit(line.value));
  byId("contract-undo").addEventListener("click", () => edit(null));
  byId("contract-form").addEventListener("submit", (event) => {
    event.preventDefault();
    void ask(current());
  });
}
