// Where the picture can be trusted: PSNR over the angle between the view and the generation camera, as measured at the test views.

import type { StepRow } from "./api";
import type { Pose } from "./engine/wasm";
import { GUTTER, type Mark, type Point, caption, costLabel, decibelScale, decibelText, decibels, dot, fixed, gridLine, niceTicks, pathOf } from "./plots";
import { byId, clamp, shownIndex, store, view } from "./state";

const RADIAN = 180 / Math.PI;

/** Degrees between a view and the camera that the shown step was generated from. */
export function viewAngle({ azimuth, elevation }: Pose): number {
  return Math.acos(clamp(Math.cos(azimuth / RADIAN) * Math.cos(elevation / RADIAN), -1, 1)) * RADIAN;
}

/** The test views of a step by their angle: those to both sides together, by their mean. */
function measuredAngles(row: StepRow | null): Mark[] {
  const sides = new Map<number, number[]>();
  for (const { angle_deg, psnr_db } of row?.views ?? []) {
    const db = decibels(psnr_db);
    if (db === null || !Number.isFinite(db)) continue;
    const angle = Math.round(viewAngle({ ...view.pose, azimuth: angle_deg, elevation: 0 }) * 1e6) / 1e6;
    sides.set(angle, [...(sides.get(angle) ?? []), db]);
  }
  const mean = (all: number[]) => all.reduce((sum, db) => sum + db, 0) / all.length;
  return [...sides].map(([cost, all]) => ({ cost, db: mean(all) })).sort((a, b) => a.cost - b.cost);
}

/** Steps before the shown one that are looked at. */
const LOOK_BACK = 32;

/** The shown step, or the last one before it that was measured: the newest is measured soon after it has come. */
function lastMeasured(): StepRow | null {
  const at = shownIndex();
  const rows = store.steps.slice(Math.max(at - LOOK_BACK, 0), at + 1);
  return rows.reverse().find(({ views }) => views.length > 0) ?? null;
}

/** Decibels at `angle`, linearly between the test views; null beyond them. */
function decibelsAt(marks: Mark[], angle: number): number | null {
  const next = marks.findIndex(({ cost }) => cost >= angle);
  const [after, before] = [marks[next], marks[Math.max(next - 1, 0)]];
  if (!after || !before) return null;
  const share = after.cost > before.cost ? clamp((angle - before.cost) / (after.cost - before.cost), 0, 1) : 0;
  return before.db + share * (after.db - before.db);
}

export function drawTrust(): void {
  const box = byId("trust").querySelector<HTMLElement>(".plot")!;
  const [width, height] = [box.clientWidth, box.clientHeight];
  const marks = measuredAngles(lastMeasured());
  const here = viewAngle(view.pose);
  const db = decibelsAt(marks, here);
  const [name, detail] = caption("trust");
  name.innerHTML = `PSNR from here <b>${decibelText(db)}</b> dB`;
  detail.textContent = marks.length === 0 ? "" : db === null ? `${fixed(here, 0)}° off, not measured` : `${fixed(here, 0)}° off`;
  const svg = box.firstElementChild!;
  if (marks.length === 0) {
    svg.innerHTML = "";
    return;
  }
  const widest = Math.max(marks[marks.length - 1]!.cost, here) * 1.05;
  const x = (angle: number) => GUTTER + (angle / widest) * (width - 8 - GUTTER);
  const { y, low, high } = decibelScale(marks, height);
  const points = marks.map(({ cost, db: value }): Point => [x(cost), y(value)]);
  svg.innerHTML = [
    ...niceTicks(low, high, 3).map((tick) => gridLine(y(tick), width, String(tick))),
    ...niceTicks(0, widest, 4).map((tick) => costLabel(x(tick), height, `${tick}°`)),
    `<path class="cursor" d="M${x(here).toFixed(1)} 0V${height - 17}"/>`,
    `<path class="curve" d="${pathOf(points)}"/>`,
    ...points.map(([px, py]) => dot("dot", px, py, 2)),
    db === null ? "" : dot("here", x(here), y(db), 3.5),
  ].join("");
}
