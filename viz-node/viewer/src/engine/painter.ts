// Pictures drawn in the browser: steps are fetched once, decoded and drawn by the worker, and kept while there is room.

import type { Device, Reply, Request } from "./protocol";
import type { Description, Pose, Slice } from "./wasm";

/** Encoded bytes of steps that are kept decoded: decoded they take 20 to 40 times as much. */
const KEPT_BYTES = 8 << 20;
/** What a sample point or supersegment counts as, where a step coded after another one takes fewer. */
const BYTES_OF_ELEMENT = 1 / 6;
/** The most of them. */
const KEPT_STEPS = 6;

export interface Picture {
  step: number;
  bitmap: ImageBitmap;
  drawMs: number;
  /** What drew it. */
  by: "gpu" | "cpu" | "server";
}

type Drawn = Omit<Picture, "step">;

/** The server or the step refuses; asking again is in vain. */
export class Refused extends Error {}

interface Kept {
  key: string;
  bytes: number;
  opened: Promise<Description>;
  description: Description | null;
}

interface Opened {
  bytes: number;
  description: Description;
}

export class BrowserPainter {
  device: Device | null = null;
  /** Milliseconds that the last step took to decode, and how many workers did. */
  decodeMs = NaN;
  decoders = NaN;
  /** Bytes of steps fetched so far. */
  fetchedBytes = 0;
  private readonly ready: Promise<void>;
  private readonly kept: Kept[] = [];
  private readonly openings = new Map<string, { resolve(opened: Description): void; reject(reason: Error): void }>();
  private readonly drawings = new Map<number, { resolve(drawn: Drawn | null): void; reject(reason: Error): void }>();
  private readonly slices = new Map<number, { resolve(slice: Slice): void; reject(reason: Error): void }>();
  private nextId = 1;

  /**
   * `changed` is called when it is known what draws, and when that changes; `absent` if nothing here can. `before` gives the step that a step of
   * the run was coded after.
   */
  constructor(
    private readonly worker: Worker,
    private readonly before: (run: string, step: number) => number | null,
    private readonly changed: () => void,
    absent: () => void,
  ) {
    this.ready = new Promise((resolve, reject) => {
      worker.onmessage = ({ data }: MessageEvent<Reply>) => {
        if (data.kind === "ready") {
          this.device = data.device;
          this.changed();
          resolve();
        } else {
          this.take(data);
        }
      };
      worker.onerror = (event) => {
        const error = new Error(event.message || "the worker that draws did not start");
        reject(error);
        [...this.openings.values(), ...this.drawings.values()].forEach((waiting) => waiting.reject(error));
      };
    });
    this.ready.catch(absent);
  }

  private send(request: Request, transfer: Transferable[] = []): void {
    this.worker.postMessage(request, transfer);
  }

  private take(message: Reply): void {
    if (message.kind === "device") {
      this.device = message.device;
      this.changed();
    } else if (message.kind === "opened") {
      [this.decodeMs, this.decoders] = [message.decodeMs, message.decoders];
      this.openings.get(message.key)?.resolve(message.description);
    } else if (message.kind === "refused") {
      this.openings.get(message.key)?.reject(new Refused(message.reason));
    } else if (message.kind === "sliced") {
      this.slices.get(message.id)?.resolve(message.slice);
      this.slices.delete(message.id);
    } else if (message.kind === "failed" && this.slices.has(message.id)) {
      this.slices.get(message.id)!.reject(new Error(message.reason));
      this.slices.delete(message.id);
    } else if (message.kind !== "ready") {
      const waiting = this.drawings.get(message.id);
      this.drawings.delete(message.id);
      if (message.kind === "drawn") {
        if (waiting) waiting.resolve(message);
        else message.bitmap.close();
      } else if (message.kind === "dropped") waiting?.resolve(null);
      else waiting?.reject(new Error(message.reason));
    }
  }

  /** A picture of `step` of `run`, fetched if it is not held; null if `signal` was given up. */
  async draw(
    run: string,
    step: number,
    pose: Pose,
    side: number,
    still: boolean,
    appearance: string | null,
    signal: AbortSignal,
  ): Promise<Picture | null> {
    await this.ready;
    const key = `${run}/${step}`;
    await this.hold(run, step);
    if (signal.aborted) return null;
    const id = this.nextId++;
    const drawn = new Promise<Drawn | null>((resolve, reject) => {
      this.drawings.set(id, { resolve, reject });
    });
    signal.addEventListener("abort", () => this.send({ kind: "cancel", id }), { once: true });
    this.send({ kind: "draw", id, key, pose, side, still, appearance });
    const picture = await drawn;
    return picture && { step, ...picture };
  }

  /** A plane of a volume that is held. */
  slice(run: string, step: number, axis: number, at: number): Promise<Slice> {
    const id = this.nextId++;
    return new Promise((resolve, reject) => {
      this.slices.set(id, { resolve, reject });
      this.send({ kind: "slice", id, key: `${run}/${step}`, axis, at });
    });
  }

  /** What is known of a step that is held. */
  description(run: string, step: number): Description | null {
    return this.kept.find((kept) => kept.key === `${run}/${step}`)?.description ?? null;
  }

  /** Fetches a step ahead of its picture. */
  async hold(run: string, step: number): Promise<Description> {
    const key = `${run}/${step}`;
    const known = this.kept.findIndex((kept) => kept.key === key);
    if (known >= 0) {
      const [kept] = this.kept.splice(known, 1);
      this.kept.push(kept!);
      return kept!.opened;
    }
    const opened = this.open(run, step);
    const kept: Kept = { key, bytes: 0, opened: opened.then(({ description }) => description), description: null };
    this.kept.push(kept);
    opened.then(
      ({ bytes, description }) => {
        Object.assign(kept, { bytes: Math.max(bytes, BYTES_OF_ELEMENT * description.elements), description });
        this.makeRoom();
      },
      () => {
        const at = this.kept.indexOf(kept);
        if (at >= 0) this.kept.splice(at, 1);
      },
    );
    return kept.opened;
  }

  /** Fetches a step: alone, if the one that it was coded after is held, else with that one and those before. */
  private async open(run: string, step: number): Promise<Opened> {
    const before = this.before(run, step);
    const held = this.kept.find((kept) => kept.key === `${run}/${before}`);
    const isHeld = held !== undefined && (await held.opened.catch(() => null)) !== null;
    if (!isHeld) return this.fetched(run, step, "");
    // The one before may have made room meanwhile.
    return this.fetched(run, step, "&alone=true").catch(() => this.fetched(run, step, ""));
  }

  private async fetched(run: string, step: number, alone: string): Promise<Opened> {
    const key = `${run}/${step}`;
    const answer = await fetch(`api/step/${step}?run=${encodeURIComponent(run)}${alone}`, { cache: "no-store" });
    if (!answer.ok) {
      const reason = (await answer.text()).trim() || `the server answered ${answer.status}`;
      throw answer.status < 500 ? new Refused(reason) : new Error(reason);
    }
    const bytes = await answer.arrayBuffer();
    this.fetchedBytes += bytes.byteLength;
    const opened = new Promise<Description>((resolve, reject) => this.openings.set(key, { resolve, reject }));
    const size = bytes.byteLength;
    this.send({ kind: "open", key, bytes }, [bytes]);
    const description = await opened.finally(() => this.openings.delete(key));
    return { bytes: size, description };
  }

  private makeRoom(): void {
    const held = () => this.kept.reduce((sum, { bytes }) => sum + bytes, 0);
    while (this.kept.length > 1 && (this.kept.length > KEPT_STEPS || held() > KEPT_BYTES)) {
      this.send({ kind: "close", key: this.kept.shift()!.key });
    }
  }
}
