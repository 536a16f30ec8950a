// The measured Pareto front of quality against size: a point pressed asks for its size.

import type { StepRow } from "./api";
import { askForSize, mayAsk } from "./contract";
import {
  GUTTER, type Mark, type Point, caption, costLabel, decibelScale, decibelText, dot, drawMarks, fixed, front, kilobytes, measured,
} from "./plots";
import { byId, shownRow, store } from "./state";

const box = () => byId("pareto").querySelector<HTMLElement>(".plot")!;
const bytesOf = (row: StepRow): number => row.size_bytes;

/** The trials of the newest study that has any. */
function newestTrials(): Mark[] {
  const newest = Math.max(...store.trials.map(({ step }) => step));
  return measured(store.trials.filter(({ step }) => step === newest), bytesOf);
}

/** The least and most bytes to draw, and what maps them, on a logarithmic scale, to x. */
function sizeScale(marks: Mark[], width: number) {
  const sizes = marks.map(({ cost }) => Math.log(cost));
  const [least, most] = [Math.min(...sizes) - 0.1, Math.max(...sizes) + 0.1];
  const x = (bytes: number) => GUTTER + ((Math.log(bytes) - least) / (most - least)) * (width - 8 - GUTTER);
  return { x, least: Math.exp(least), most: Math.exp(most) };
}

/** 1, 2 and 5 of every power of ten within the range. */
function sizeTicks(least: number, most: number): number[] {
  const ticks = [];
  for (let power = 10 ** Math.floor(Math.log10(least)); power <= most; power *= 10) {
    ticks.push(...[1, 2, 5].map((m) => m * power).filter((tick) => tick >= least && tick <= most));
  }
  return ticks.length > 6 ? ticks.filter((tick) => String(tick).startsWith("1")) : ticks;
}

export function drawPareto(): void {
  const [width, height] = [box().clientWidth, box().clientHeight];
  const trials = newestTrials();
  const best = front(trials);
  const row = shownRow();
  const known = row ? measured([row], bytesOf)[0] : undefined;
  const [name, detail] = caption("pareto");
  name.innerHTML = `PSNR by size <b>${known ? decibelText(known.db) : "–"}</b> dB`;
  detail.textContent = best.length > 0 ? (mayAsk() ? "press a point to ask for it" : `${best.length} best trials`) : "";
  const svg = box().firstElementChild!;
  if (best.length === 0) {
    svg.innerHTML = "";
    return;
  }
  const all = known ? [...trials, known] : trials;
  const { x, least, most } = sizeScale(all, width);
  const { y } = decibelScale(all, height);
  const limit = store.limit.size_bytes;
  svg.innerHTML = [
    ...sizeTicks(least, most).map((tick) => costLabel(x(tick), height, `${kilobytes(tick)} kB`)),
    limit !== null && limit > least && limit < most ? `<path class="bound" d="M${x(limit).toFixed(1)} 8V${height - 17}"/>` : "",
    drawMarks(box(), x, trials, [], known),
    ...best.map((mark) => pointButton(mark, [x(mark.cost), y(mark.db)])),
  ].join("");
}

/** A point of the front: a button, also for the keyboard and for readers of the screen. */
function pointButton({ cost: bytes, db }: Mark, [px, py]: Point): string {
  const words = `${fixed(kilobytes(bytes), 1)} kB, ${decibelText(db)} dB`;
  const button = mayAsk() ? `role="button" tabindex="0" aria-label="Ask for ${words}" data-bytes="${bytes}"` : `role="img" aria-label="${words}"`;
  return `<g class="point" ${button}><title>${words}</title>${dot("reach", px, py, 9)}${dot("dot", px, py, 3)}</g>`;
}

export function listenToPareto(): void {
  const press = (event: Event) => {
    const bytes = (event.target as Element).closest<SVGElement>(".point")?.dataset.bytes;
    if (bytes !== undefined) askForSize(Number(bytes));
    return bytes !== undefined;
  };
  box().addEventListener("click", press);
  box().addEventListener("keydown", (event) => {
    if ((event.key === "Enter" || event.key === " ") && press(event)) event.preventDefault();
  });
}
