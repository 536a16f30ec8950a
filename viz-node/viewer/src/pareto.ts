// The measured Pareto front of quality against size: a point pressed asks for its size.

import type { StepRow } from "./api";
import { askForSize, mayAsk } from "./contract";
import { GUTTER, type Point, decibelText, decibels, fixed, gridLine, kilobytes, niceTicks, pathOf, valueRange } from "./plots";
import { byId, shownRow, store } from "./state";

interface Mark {
  bytes: number;
  db: number;
}

const box = () => byId("pareto").querySelector<HTMLElement>(".plot")!;

const measured = (rows: StepRow[]): Mark[] =>
  rows.flatMap((row) => {
    const db = decibels(row.psnr_db);
    return db !== null && Number.isFinite(db) ? [{ bytes: row.size_bytes, db }] : [];
  });

/** The trials of the newest study that has any. */
function newestTrials(): Mark[] {
  const newest = Math.max(...store.trials.map(({ step }) => step));
  return measured(store.trials.filter(({ step }) => step === newest));
}

/** Those that no smaller one beats, by rising size. */
function front(marks: Mark[]): Mark[] {
  let best = -Infinity;
  return [...marks].sort((a, b) => a.bytes - b.bytes || b.db - a.db).filter(({ db }) => db > best && ((best = db), true));
}

/** Maps bytes, on a logarithmic scale, and decibels to the drawing. */
function scales(marks: Mark[], width: number, height: number) {
  const sizes = marks.map(({ bytes }) => Math.log(bytes));
  const [least, most] = [Math.min(...sizes) - 0.1, Math.max(...sizes) + 0.1];
  const [low, high] = valueRange(marks.map(({ db }) => db), null, true);
  const bottom = height - 17;
  const x = (bytes: number) => GUTTER + ((Math.log(bytes) - least) / (most - least)) * (width - 8 - GUTTER);
  const y = (db: number) => bottom - ((db - low) / (high - low)) * (bottom - 8);
  return { x, y, low, high, least: Math.exp(least), most: Math.exp(most) };
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
  const shown = row ? measured([row]) : [];
  const svg = box().firstElementChild!;
  const [name, detail] = [...byId("pareto").querySelectorAll("figcaption span")] as [Element, Element];
  name.innerHTML = `PSNR by size <b>${shown[0] ? decibelText(shown[0].db) : "–"}</b> dB`;
  detail.textContent = best.length > 0 ? (mayAsk() ? "press a point to ask for it" : `${best.length} best trials`) : "";
  if (best.length === 0) {
    svg.innerHTML = "";
    return;
  }
  const { x, y, low, high, least, most } = scales([...trials, ...shown], width, height);
  const at = ({ bytes, db }: Mark): Point => [x(bytes), y(db)];
  const limit = store.limit.size_bytes;
  svg.innerHTML = [
    ...niceTicks(low, high, 3).map((tick) => gridLine(y(tick), width, String(tick))),
    ...sizeTicks(least, most).map((tick) =>
      `<text x="${x(tick).toFixed(1)}" y="${height - 3}" text-anchor="middle">${kilobytes(tick)} kB</text>`),
    limit !== null && limit > least && limit < most ? `<path class="bound" d="M${x(limit).toFixed(1)} 8V${height - 17}"/>` : "",
    `<path class="trial" d="${trials.map((mark) => `M${at(mark).map(Math.round).join(" ")}m-2 0h4m-2-2v4`).join("")}"/>`,
    `<path class="curve" d="${pathOf(best.map(at))}"/>`,
    ...shown.map((mark) => `<circle class="here" cx="${at(mark)[0].toFixed(1)}" cy="${at(mark)[1].toFixed(1)}" r="3.5"/>`),
    ...best.map((mark) => pointButton(mark, at(mark))),
  ].join("");
}

/** A point of the front: a button, also for the keyboard and for readers of the screen. */
function pointButton({ bytes, db }: Mark, [px, py]: Point): string {
  const words = `${fixed(kilobytes(bytes), 1)} kB, ${decibelText(db)} dB`;
  const button = mayAsk() ? `role="button" tabindex="0" aria-label="Ask for ${words}" data-bytes="${bytes}"` : `role="img" aria-label="${words}"`;
  return `<g class="point" ${button}><title>${words}</title><circle class="reach" cx="${px.toFixed(1)}" cy="${py.toFixed(1)}" r="9"/>
    <circle class="dot" cx="${px.toFixed(1)}" cy="${py.toFixed(1)}" r="3"/></g>`;
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
