// The volume's box and axes, drawn over the picture from the same camera.

import { painter } from "./picture";
import { significant } from "./plots";
import { byId, clamp, picture } from "./state";
import type { Pose, RecordedCamera } from "./engine/wasm";

type Vector = [number, number, number];

const add = (a: Vector, b: Vector): Vector => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const scaled = (a: Vector, s: number): Vector => [a[0] * s, a[1] * s, a[2] * s];
const minus = (a: Vector, b: Vector): Vector => add(a, scaled(b, -1));
const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a: Vector, b: Vector): Vector => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a: Vector): Vector => scaled(a, 1 / Math.hypot(...a));

/** `a` turned about the unit vector `axis` (Rodrigues' formula). */
function turned(a: Vector, axis: Vector, degrees: number): Vector {
  const [cos, sin] = [Math.cos((degrees * Math.PI) / 180), Math.sin((degrees * Math.PI) / 180)];
  return add(add(scaled(a, cos), scaled(cross(axis, a), sin)), scaled(axis, dot(axis, a) * (1 - cos)));
}

/** Where the camera of `pose` sees a point: right and down from the picture's middle in halves of its side; null behind the eye. */
export function projection(camera: RecordedCamera, pose: Pose): (point: Vector) => [number, number] | null {
  const back = minus(camera.position, camera.target);
  const right = unit(cross(scaled(back, -1), camera.up));
  const up = cross(right, unit(scaled(back, -1)));
  const moved = (a: Vector) => turned(turned(a, right, -pose.elevation), up, pose.azimuth);
  const arm = scaled(moved(back), 1 / pose.zoom);
  const forward = unit(scaled(arm, -1));
  const level = unit(cross(forward, moved(up)));
  const upright = cross(level, forward);
  const half = Math.tan((camera.fov_y_deg * Math.PI) / 360);
  const height = 2 * half * Math.hypot(...arm);
  const eye = add(add(add(camera.target, arm), scaled(level, pose.right * height)), scaled(upright, pose.up * height));
  const [x, y] = [level, upright].map((axis) => turned(axis, forward, -pose.roll)) as [Vector, Vector];
  return (point) => {
    const from = minus(point, eye);
    const depth = dot(from, forward) * half;
    return depth > 1e-9 * height ? [dot(from, x) / depth, -dot(from, y) / depth] : null;
  };
}

/** Whether it is wanted. */
export const overlay = { shown: false };

export function toggleOverlay(): void {
  overlay.shown = !overlay.shown;
  byId("box").setAttribute("aria-pressed", String(overlay.shown));
  drawOverlay();
}

/** Follows the picture on the stage, not the camera that is ahead of it. */
export function drawOverlay(): void {
  const svg = byId("overlay");
  const description = picture.shown && painter?.description(picture.shown.run, picture.shown.step);
  if (!overlay.shown || !picture.shown || !description) {
    svg.replaceChildren();
    return;
  }
  const { camera, bounds } = description;
  const project = projection(camera, picture.shown.pose);
  const corner = (n: number): Vector => [0, 1, 2].map((axis) => bounds[(n >> axis) & 1]![axis]!) as Vector;
  const parts: string[] = [];
  for (let n = 0; n < 8; n++) {
    for (let axis = 0; axis < 3; axis++) {
      const other = n | (1 << axis);
      const [a, b] = [project(corner(n)), project(corner(other))];
      if (other === n || !a || !b) continue;
      const name = n === 0 ? ` axis-${"xyz"[axis]}` : "";
      parts.push(`<path class="edge${name}" d="M${a.map((c) => c.toFixed(4)).join(" ")}L${b.map((c) => c.toFixed(4)).join(" ")}"/>`);
      if (n === 0) {
        const text = `${"xyz"[axis]} ${significant(bounds[0]![axis]!, 3)} to ${significant(bounds[1]![axis]!, 3)}`;
        const [x, y] = [clamp(b[0] * 1.04, -0.82, 0.82), clamp(b[1] * 1.04, -0.94, 0.97)];
        parts.push(`<text x="${x.toFixed(4)}" y="${y.toFixed(4)}" text-anchor="middle">${text}</text>`);
      }
    }
  }
  svg.innerHTML = parts.join("");
}
