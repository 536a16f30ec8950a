// What the server answers, as JSON.

import type { Effects, TransferFunction } from "./engine/wasm";

export type { ControlPoint } from "./engine/wasm";

/** JSON has no infinity: identical pictures come as "inf". */
export type Decibels = number | "inf" | null;

export interface StepRow {
  step: number;
  time: number;
  resolution: number;
  gamma: number;
  size_bytes: number;
  generation_ms: number;
  psnr_db: Decibels;
  encode_ms: number;
  supersegments: number;
  dropped_steps: number;
  /** NaN or infinite, drawn as empty. */
  empty_voxels: number;
  /** Ranks that fell silent: where their bricks would be is a hole. */
  lost_ranks: number[];
  /** Names of triggers that fired at the step. */
  triggers: string[];
  /** What computing the shown field from the run's took. */
  derivation_ms: number;
  /** The limits that were in force. */
  size_limit_bytes: number | null;
  time_limit_ms: number | null;
  limit_kept: boolean;
  views: { angle_deg: number; psnr_db: Decibels }[];
  representation: "vdi" | "volume";
  half_width_db: number | null;
  /** Structural similarity, where all pixels of the views were compared. */
  ssim: number | null;
  /** The step that this one was coded after; null for a key frame. */
  after_step: number | null;
  measured: "no" | "pending" | "skipped" | "yes";
  tuning: "none" | "provisional" | "done";
  overhead: number | null;
  throttle: number;
  /** What the simulation told of the step beside its field, by name; null is NaN or infinite. */
  diagnostics: Record<string, number | null>;
}

export interface Run {
  id: string;
  name: string;
  field: string;
  dims: [number, number, number];
}

/** A run recorded beside the current one, and when its steps were. */
export interface RunSteps {
  run: Run;
  steps: { step: number; time: number }[];
}

export interface Study {
  step: number;
  first: boolean;
  trials: number;
  best_psnr_db: Decibels;
  best_size_bytes: number;
}

/** What the tuner says. */
export interface Tuner {
  /** In force, as users write it. */
  contract: string;
  busy: boolean;
  studies: number;
  chosen_psnr_db: Decibels;
  last_error: string;
}

/** A number of the simulation that may be changed. */
export interface SteerableNumber {
  name: string;
  value: number;
  least: number;
  most: number;
}

/** What is done where a trigger fires, beside that it is recorded. */
export type TriggerAction = "pause" | "stop" | "raw" | "picture" | "copy" | "webhook";

/** A condition over each step, and what is done at the step where it becomes true. */
export interface Trigger {
  name: string;
  when: string;
  do: TriggerAction[];
  /** The most kilobytes of a copy. */
  copy_kb?: number;
  /** Degrees that pictures are turned by about the y axis. */
  angles?: number[];
}

/** What the simulation can be asked for. */
export interface Steerable {
  listens: boolean;
  paused: boolean;
  stopping: boolean;
  numbers: SteerableNumber[];
  /** The run's fields, and what is to be shown of them. */
  fields: string[];
  shown: string;
  /** In which colors, and with which effects. */
  transfer: TransferFunction | null;
  effects: Effects | null;
  /** Null where they cannot be changed. */
  triggers: Trigger[] | null;
}

export interface PageState {
  run: Run | null;
  limit: { size_bytes: number | null; time_ms: number | null };
  steps: StepRow[];
  missed_steps: number;
  study: Study | null;
  tuner: Tuner | null;
  may_steer: boolean;
  steerable: Steerable;
}

/** A transfer function, and the positions whose values were not recorded. */
export interface Transfer extends TransferFunction {
  unrecorded: [number, number][];
  /** Empty where it is not known. */
  histogram?: number[];
}
