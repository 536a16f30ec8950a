// The readout: measurements of the shown step, in words.

import type { StepRow } from "./api";
import { jumpTo } from "./camera";
import { decibelText, decibels, fixed, kilobytes, significant } from "./plots";
import { FRONT, byId, shownRow, store } from "./state";
import { setText } from "./status";

/** PSNR with its 95 % interval, or why there is none. */
function psnrText({ psnr_db, half_width_db, measured }: StepRow): string {
  if (psnr_db === null) return measured === "pending" ? "not yet" : "not measured";
  const value = decibelText(decibels(psnr_db));
  return half_width_db === null ? `${value} dB` : `${value} ± ${half_width_db.toFixed(1)} dB`;
}

const TUNING_TEXT: Record<string, string> = { none: "untuned", provisional: "provisional", done: "tuned" };

function readoutFields(row: StepRow): [string, string, boolean?][] {
  const { size_bytes, time_ms } = store.limit;
  const overSize = size_bytes !== null && row.size_bytes > size_bytes;
  const overTime = time_ms !== null && row.generation_ms > time_ms;
  // Limits may have changed since; then the step itself carries the mark.
  const overThen = !row.limit_kept && !overSize && !overTime;
  const isVolume = row.representation === "volume";
  return [
    ["Step", String(row.step), overThen],
    ["Time", significant(row.time, 5)],
    ["PSNR", psnrText(row)],
    ...(row.ssim === null ? [] : [["SSIM", row.ssim.toFixed(4)] as [string, string]]),
    isVolume ? ["Volume, longest side", `${row.resolution} points`] : ["Resolution r", `${row.resolution} × ${row.resolution}`],
    [isVolume ? "Error bound" : "Gamma γ", significant(row.gamma, 3)],
    [isVolume ? "Points" : "Supersegments", row.supersegments.toLocaleString("en")],
    [row.after_step === null ? "Size" : `Size, after step ${row.after_step}`, `${fixed(kilobytes(row.size_bytes), 1)} kB`, overSize],
    // The coding of a volume is what makes it small, and counts as its generation.
    [isVolume ? "Generation, with coding" : "Generation", `${fixed(row.generation_ms, 1)} ms`, overTime],
    ...(isVolume ? [] : [["Encode", `${fixed(row.encode_ms, 1)} ms`] as [string, string]]),
    ["Parameters", TUNING_TEXT[row.tuning] ?? "–"],
    ...exceptions(row),
    ...Object.entries(row.diagnostics).map(([name, value]): [string, string] => [name, value === null ? "not finite" : significant(value, 5)]),
  ];
}

/** What most steps do not have. */
function exceptions({ derivation_ms, empty_voxels, lost_ranks, triggers }: StepRow): [string, string][] {
  const found: [string, string][] = [];
  if (derivation_ms > 0) found.push(["Field computed in", `${fixed(derivation_ms, 1)} ms`]);
  if (empty_voxels > 0) found.push(["Missing voxels", empty_voxels.toLocaleString("en")]);
  if (lost_ranks.length > 0) found.push(["Silent ranks", lost_ranks.length > 4 ? String(lost_ranks.length) : lost_ranks.join(", ")]);
  if (triggers.length > 0) found.push(["Triggers", triggers.join(", ")]);
  return found;
}

/** What the nodes cost the simulation and are allowed, as far as it is known. */
function overheadText({ overhead, throttle }: StepRow): string {
  const parts = [];
  if (overhead !== null) parts.push(`overhead ${(100 * overhead).toFixed(1)} %`);
  // Rows from before there were shares carry 0.
  if (throttle > 0) parts.push(`nodes at ${(100 * throttle).toFixed(0)} % of their share`);
  return parts.join(", ");
}

/** Elements are kept from step to step: only texts that differ are written. */
export function drawReadout() {
  const row = shownRow();
  const fields = row ? readoutFields(row) : [];
  const list = byId("readout");
  while (list.children.length > fields.length) list.lastElementChild!.remove();
  while (list.children.length < fields.length) {
    const item = document.createElement("div");
    item.append(document.createElement("dt"), document.createElement("dd"));
    list.append(item);
  }
  fields.forEach(([name, value, broken = false], i) => {
    const [term, detail] = [...list.children[i]!.children] as [HTMLElement, HTMLElement];
    setText(term, name);
    setText(detail, value);
    detail.className = broken ? "broken" : "";
    detail.title = broken ? "breaks the limit" : "";
  });
  setText(byId("overhead"), row ? overheadText(row) : "");
  drawViews(row);
}

/** One button a test view: its PSNR, and a way to look from there. Kept across steps so that the focus stays. */
function drawViews(row: StepRow | null): void {
  const box = byId("views");
  // A step is measured soon after it has come: the buttons stay, without values, so that nothing below them jumps.
  const pending = row?.measured === "pending";
  const buttons = () => [...box.children] as HTMLElement[];
  const angles = pending ? buttons().map((button) => Number(button.dataset.angle)) : [];
  const views = pending ? angles.map((angle_deg) => ({ angle_deg, psnr_db: NaN })) : (row?.views ?? []);
  while (box.children.length > views.length) box.lastElementChild!.remove();
  while (box.children.length < views.length) {
    const button = document.createElement("button");
    button.type = "button";
    button.addEventListener("click", () => jumpTo({ ...FRONT, azimuth: Number(button.dataset.angle) }));
    button.append(document.createElement("span"), document.createElement("b"));
    box.append(button);
  }
  views.forEach(({ angle_deg, psnr_db }, i) => {
    const [button, value] = [buttons()[i]!, decibelText(decibels(psnr_db))];
    const title = `Test view at ${angle_deg}°: ${value === "–" ? "not measured yet" : `${value} dB`}. Look from there.`;
    if (button.title === title) return;
    button.dataset.angle = String(angle_deg);
    button.title = title;
    button.setAttribute("aria-label", title);
    setText(button.children[0]!, `${angle_deg}°`);
    setText(button.children[1]!, value);
  });
}
