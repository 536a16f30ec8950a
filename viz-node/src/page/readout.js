// The readout: measurements of the shown step, in words.
"use strict";

/** PSNR with its 95 % interval, or why there is none. */
function psnrText({ psnr_db, half_width_db, measured }) {
  if (psnr_db === null) return measured === "pending" ? "not yet" : "not measured";
  const value = decibelText(decibels(psnr_db));
  return Number.isFinite(half_width_db) ? `${value} ± ${half_width_db.toFixed(1)} dB` : `${value} dB`;
}

const TUNING_TEXT = { none: "untuned", provisional: "provisional", done: "tuned" };

function readoutFields(row) {
  const { size_bytes, time_ms } = store.limit;
  const overSize = size_bytes !== null && row.size_bytes > size_bytes;
  const overTime = time_ms !== null && row.generation_ms > time_ms;
  // Limits may have changed since; then the step itself carries the mark.
  const overThen = !row.limit_kept && !overSize && !overTime;
  return [
    ["Step", String(row.step), overThen],
    ["Time", significant(row.time, 5)],
    ["PSNR", psnrText(row)],
    ...(row.representation === "volume"
      ? [["Volume, longest side", `${row.resolution} points`], ["Error bound", significant(row.gamma, 3)]]
      : [["Resolution r", `${row.resolution} × ${row.resolution}`], ["Gamma γ", significant(row.gamma, 3)]]),
    [row.representation === "volume" ? "Points" : "Supersegments", row.supersegments.toLocaleString("en")],
    ["Size", `${fixed(kilobytes(row.size_bytes), 1)} kB`, overSize],
    ["Generation", `${fixed(row.generation_ms, 1)} ms`, overTime],
    ["Encode", `${fixed(row.encode_ms, 1)} ms`],
    ["Parameters", TUNING_TEXT[row.tuning] ?? "–"],
  ];
}

/** What the nodes cost the simulation and are allowed, as far as it is known. */
function overheadText({ overhead, throttle }) {
  const parts = [];
  if (Number.isFinite(overhead)) parts.push(`overhead ${(100 * overhead).toFixed(1)} %`);
  // Rows from before there were shares carry 0.
  if (throttle > 0) parts.push(`nodes at ${(100 * throttle).toFixed(0)} % of their share`);
  return parts.join(", ");
}

/** Elements are kept from step to step: only texts that differ are written. */
function drawReadout() {
  const row = shownRow();
  const fields = row ? readoutFields(row) : [];
  const list = byId("readout");
  while (list.children.length > fields.length) list.lastChild.remove();
  while (list.children.length < fields.length) {
    const item = document.createElement("div");
    item.append(document.createElement("dt"), document.createElement("dd"));
    list.append(item);
  }
  fields.forEach(([name, value, broken = false], i) => {
    const [term, detail] = list.children[i].children;
    setText(term, name);
    setText(detail, value);
    detail.className = broken ? "broken" : "";
    detail.title = broken ? "breaks the limit" : "";
  });
  setText(byId("overhead"), row ? overheadText(row) : "");
  drawViews(row);
}

/** One button a test view: its PSNR, and a way to look from there. Kept across steps so that the focus stays. */
function drawViews(row) {
  const box = byId("views");
  // A step is measured soon after it has come: the buttons stay, without values, so that nothing below them jumps.
  const pending = row?.measured === "pending";
  const angles = pending ? [...box.children].map((button) => Number(button.dataset.angle)) : [];
  const views = pending ? angles.map((angle_deg) => ({ angle_deg, psnr_db: NaN })) : (row?.views ?? []);
  while (box.children.length > views.length) box.lastChild.remove();
  while (box.children.length < views.length) {
    const button = document.createElement("button");
    button.type = "button";
    button.addEventListener("click", () => jumpTo(Number(button.dataset.angle), 0, 1));
    button.append(document.createElement("span"), document.createElement("b"));
    box.append(button);
  }
  views.forEach(({ angle_deg, psnr_db }, i) => {
    const [button, value] = [box.children[i], decibelText(decibels(psnr_db))];
    const title = `Test view at ${angle_deg}°: ${value === "–" ? "not measured yet" : `${value} dB`}. Look from there.`;
    if (button.title === title) return;
    button.dataset.angle = angle_deg;
    button.title = title;
    button.setAttribute("aria-label", title);
    setText(button.children[0], `${angle_deg}°`);
    setText(button.children[1], value);
  });
}
