// The camera of a pose: where it sees points of the world, and how large.

import type { Pose, RecordedCamera } from "./engine/wasm";
import { type Vector, add, cross, dot, minus, scaled, turned, unit } from "./vector";

export interface Projection {
  /** Right and down from the picture's middle in halves of its side; null behind the eye. */
  place(point: Vector): [number, number] | null;
  /** A direction of the world as the eye sees it: right, down, away. */
  direction(along: Vector): Vector;
  /** World length of the picture's height at the target's depth. */
  height: number;
}

/** Towards the eye of the recorded camera, to its right and upwards. */
export function axesOf(camera: RecordedCamera): { back: Vector; right: Vector; up: Vector } {
  const back = unit(minus(camera.position, camera.target));
  const right = unit(cross(scaled(back, -1), camera.up));
  return { back, right, up: cross(right, scaled(back, -1)) };
}

/** The recorded camera moved to `pose`. */
export function projection(camera: RecordedCamera, pose: Pose): Projection {
  const { right, up } = axesOf(camera);
  const moved = (a: Vector) => turned(turned(a, right, -pose.elevation), up, pose.azimuth);
  const arm = scaled(moved(minus(camera.position, camera.target)), 1 / pose.zoom);
  const forward = unit(scaled(arm, -1));
  const level = unit(cross(forward, moved(up)));
  const upright = cross(level, forward);
  const half = Math.tan((camera.fov_y_deg * Math.PI) / 360);
  const height = 2 * half * Math.hypot(...arm);
  const shift = add(add(scaled(level, pose.right), scaled(upright, pose.up)), scaled(forward, pose.ahead));
  const eye = add(add(camera.target, arm), scaled(shift, height));
  const [x, y] = [level, upright].map((axis) => turned(axis, forward, -pose.roll)) as [Vector, Vector];
  return {
    height,
    direction: (along) => [dot(along, x), -dot(along, y), dot(along, forward)],
    place(point) {
      const from = minus(point, eye);
      const depth = dot(from, forward) * half;
      return depth > 1e-9 * height ? [dot(from, x) / depth, -dot(from, y) / depth] : null;
    },
  };
}
