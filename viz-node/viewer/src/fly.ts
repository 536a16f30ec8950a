// Flight: the eye moves and looks around, where an orbit turns about the volume.

import type { Pose } from "./engine/wasm";
import { byId } from "./state";
import { type Vector, turned } from "./vector";

/** Whether hands and keys fly. */
export const flight = { on: false };

export function toggleFlight(): void {
  flight.on = !flight.on;
  byId("fly").setAttribute("aria-pressed", String(flight.on));
  // Keys fly from there.
  if (flight.on) byId("picture").focus();
}

/** Turned by what the pose turns, or back again. */
function rotated(along: Vector, { azimuth, elevation }: Pose): Vector {
  return turned(turned(along, [1, 0, 0], -elevation), [0, 1, 0], azimuth);
}

function unrotated(along: Vector, { azimuth, elevation }: Pose): Vector {
  return turned(turned(along, [0, 1, 0], -azimuth), [1, 0, 0], elevation);
}

/** `pose` with the view turned about the eye, which stays where it is; the camera's field of view is `fovY` degrees. */
export function looked(pose: Pose, azimuth: number, elevation: number, fovY: number): Pose {
  const next = { ...pose, azimuth: pose.azimuth + azimuth, elevation: Math.min(Math.max(pose.elevation + elevation, -89), 89) };
  // From the recorded target to the eye, in heights of the picture there.
  const arm = 1 / (2 * Math.tan((fovY * Math.PI) / 360));
  const eye = unrotated(rotated([pose.right, pose.up, arm - pose.ahead], pose), next);
  return { ...next, right: eye[0], up: eye[1], ahead: arm - eye[2] };
}

/** `pose` moved to its right, up and ahead, heights of the picture at the target. */
export function moved(pose: Pose, [right, up, ahead]: Vector): Pose {
  return { ...pose, right: pose.right + right, up: pose.up + up, ahead: pose.ahead + ahead };
}
