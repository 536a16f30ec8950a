// Frame-time controller: chooses the side of a draft, the picture shown in motion, from the time that the last drafts took.

/**
 * Model: a draft of side s takes c s^2 milliseconds, from its request until it is shown. The controller keeps an exponentially
 * weighted mean of log c and chooses s = sqrt(TARGET_MS / c). Where a constant time adds to c s^2 this still settles at a side
 * that takes the target, since c is the mean at the side in use.
 */
export class DraftSize {
  static SMALLEST = 96;
  static LARGEST = 1024;
  static STEP = 32;
  /** Thirty drafts a second. */
  static TARGET_MS = 33;
  /** No draft should take longer; one that does counts more. */
  static LONGEST_MS = 80;
  static WEIGHT = 0.1;
  static WEIGHT_TOO_LONG = 0.3;
  /** The side changes when the best one is farther away than this: more than half a step, or it would flicker. */
  static HYSTERESIS = 24;

  side = 192;
  private logCost = Math.log(DraftSize.TARGET_MS / this.side ** 2);

  /** A draft of `side` pixels a side took `ms`. The mean of logarithms keeps one hiccup from halving the side. */
  record(side: number, ms: number): void {
    const weight = ms > DraftSize.LONGEST_MS ? DraftSize.WEIGHT_TOO_LONG : DraftSize.WEIGHT;
    this.logCost += weight * (Math.log(Math.max(ms, 1) / side ** 2) - this.logCost);
    const best = clampSide(Math.sqrt(DraftSize.TARGET_MS / Math.exp(this.logCost)));
    if (Math.abs(best - this.side) > DraftSize.HYSTERESIS) this.side = clampSide(Math.round(best / DraftSize.STEP) * DraftSize.STEP);
  }
}

const clampSide = (side: number) => Math.min(Math.max(side, DraftSize.SMALLEST), DraftSize.LARGEST);
