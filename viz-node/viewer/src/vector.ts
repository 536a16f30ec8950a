// Vectors of three numbers.

export type Vector = [number, number, number];

export const add = (a: Vector, b: Vector): Vector => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const scaled = (a: Vector, s: number): Vector => [a[0] * s, a[1] * s, a[2] * s];
export const minus = (a: Vector, b: Vector): Vector => add(a, scaled(b, -1));
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vector, b: Vector): Vector => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const unit = (a: Vector): Vector => scaled(a, 1 / Math.hypot(...a));

/** `a` turned about the unit vector `axis` (Rodrigues' formula). */
export function turned(a: Vector, axis: Vector, degrees: number): Vector {
  const [cos, sin] = [Math.cos((degrees * Math.PI) / 180), Math.sin((degrees * Math.PI) / 180)];
  return add(add(scaled(a, cos), scaled(cross(axis, a), sin)), scaled(axis, dot(axis, a) * (1 - cos)));
}
