// Colors as HTML writes them: #rrggbb.

import type { Vector } from "./vector";

export const hex = (color: readonly number[]): string => `#${color.map((c) => Math.round(c * 255).toString(16).padStart(2, "0")).join("")}`;
export const fromHex = (text: string): Vector => [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16) / 255) as Vector;
