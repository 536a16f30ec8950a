// One VDI decoded by several workers, which share no memory: one decodes the geometry of a band slice by slice and hands each to another,
// which decodes its colors meanwhile. The worker that draws is among the latter, and joins the bands.

import { Engine, MAX_DECODED_BYTES } from "./wasm";

/** What a worker that decodes is named: it runs the same script. */
export const BAND_WORKER = "bands";

/** Workers beside the one that draws: with it, two pairs. More would hold more memory than they save time. */
const MOST_HELPERS = 3;
/** What is coded in fewer bytes is decoded before helpers are there. */
const LEAST_BYTES = 1 << 15;

type Bytes = Uint8Array<ArrayBuffer>;

type Request =
  | { kind: "start"; module: WebAssembly.Module }
  | { kind: "geometry" | "colors"; id: number; bytes: Bytes; bands: number[]; port: MessagePort };

/** A slice of the band that is next, or null for its end; or why there is none. */
type Slice = { bytes: Bytes | null } | { reason: string };

interface Reply {
  id: number;
  decoded: Bytes[] | { reason: string };
}

const reasonOf = (error: unknown) => (error instanceof Error ? error.message : String(error));

function sendGeometry(engine: Engine, bytes: Bytes, bands: number[], port: MessagePort): void {
  const send = (slice: Slice, transfer: Transferable[] = []) => port.postMessage(slice, transfer);
  let sent = 0;
  try {
    for (const band of bands) {
      engine.beginGeometry(bytes, band);
      for (let slice = engine.geometry(); slice; slice = engine.geometry()) {
        sent += slice.length;
        // Each band alone may hold what all may hold together.
        if (sent > MAX_DECODED_BYTES) throw new Error("its bands hold more than its header states");
        send({ bytes: slice }, [slice.buffer]);
      }
      send({ bytes: null });
    }
  } catch (error) {
    send({ reason: reasonOf(error) });
  }
}

/** Decodes the colors of `bands`, whose geometry comes by `port`. */
function decodeColors(engine: Engine, bytes: Bytes, bands: number[], port: MessagePort): Promise<Bytes[]> {
  const decoded: Bytes[] = [];
  const begin = () => engine.beginColors(bytes, bands[decoded.length]!);
  return new Promise<Bytes[]>((resolve, reject) => {
    begin();
    port.onmessage = ({ data }: MessageEvent<Slice>) => {
      try {
        if ("reason" in data) throw new Error(data.reason);
        if (data.bytes) return engine.color(data.bytes);
        decoded.push(engine.endColors());
        if (decoded.length < bands.length) begin();
        else resolve(decoded);
      } catch (error) {
        reject(error instanceof Error ? error : new Error(reasonOf(error)));
      }
    };
  }).finally(() => port.close());
}

/** The worker that decodes. */
export function serveBands(): void {
  let engine: Promise<Engine> | null = null;
  onmessage = async ({ data }: MessageEvent<Request>) => {
    if (data.kind === "start") {
      engine = Engine.of(data.module);
      return;
    }
    const { kind, id, bytes, bands, port } = data;
    const running = await engine!;
    if (kind === "geometry") return sendGeometry(running, bytes, bands, port);
    const failed = (error: unknown) => ({ reason: reasonOf(error) });
    const decoded = await decodeColors(running, bytes, bands, port).catch(failed);
    const transfer = decoded instanceof Array ? decoded.map((band) => band.buffer) : [];
    postMessage({ id, decoded } satisfies Reply, { transfer });
  };
}

/** Bands `0..sizes.length` in `pairs` lists of about as many bytes each, the first the largest. */
function shared(sizes: number[], pairs: number): number[][] {
  const lists = Array.from({ length: pairs }, () => ({ bands: [] as number[], bytes: 0 }));
  const largestFirst = sizes.map((_, band) => band).sort((a, b) => sizes[b]! - sizes[a]!);
  for (const band of largestFirst) {
    const least = lists.reduce((a, b) => (b.bytes < a.bytes ? b : a));
    least.bands.push(band);
    least.bytes += sizes[band]!;
  }
  return lists.map(({ bands }) => bands).filter((bands) => bands.length > 0);
}

/** The workers that decode beside this one. */
export class BandDecoder {
  private helpers: Worker[] | null = null;
  private last: Promise<unknown> = Promise.resolve();
  private readonly waiting = new Map<number, { resolve(decoded: Bytes[]): void; reject(reason: Error): void }>();
  private nextId = 1;

  constructor(private readonly engine: Engine) {}

  /** Decodes a VDI whose bands have `sizes` bytes: the bands, in order, and how many workers decoded them. Null if this one should, alone. */
  async decode(bytes: Bytes, sizes: number[]): Promise<{ bands: Bytes[]; workers: number } | null> {
    if (sizes.reduce((sum, size) => sum + size, 0) < LEAST_BYTES) return null;
    // One after the other: each takes all workers.
    const turn = this.last.then(() => this.inPairs(bytes, sizes));
    this.last = turn.catch(() => undefined);
    return turn;
  }

  private async inPairs(bytes: Bytes, sizes: number[]): Promise<{ bands: Bytes[]; workers: number } | null> {
    this.helpers ??= this.started();
    if (this.helpers.length === 0) return null;
    const lists = shared(sizes, Math.floor((this.helpers.length + 1) / 2));
    const decoded = lists.map((bands, pair) => {
      const { port1, port2 } = new MessageChannel();
      this.ask(this.helpers![2 * pair]!, { kind: "geometry", id: 0, bytes, bands, port: port1 });
      return pair === 0
        ? this.ended(decodeColors(this.engine, bytes, bands, port2))
        : this.answer((id) => this.ask(this.helpers![2 * pair - 1]!, { kind: "colors", id, bytes, bands, port: port2 }));
    });
    const bands: Bytes[] = [];
    (await Promise.all(decoded)).forEach((list, pair) => list.forEach((band, n) => (bands[lists[pair]![n]!] = band)));
    return { bands, workers: 2 * lists.length };
  }

  private ask(helper: Worker, request: Extract<Request, { id: number }>): void {
    helper.postMessage(request, [request.port]);
  }

  private answer(ask: (id: number) => void): Promise<Bytes[]> {
    const id = this.nextId++;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      ask(id);
    });
  }

  /** `decoding`, or a failure if a helper that it waits for has ended. */
  private ended(decoding: Promise<Bytes[]>): Promise<Bytes[]> {
    const id = this.nextId++;
    const failed = new Promise<Bytes[]>((resolve, reject) => this.waiting.set(id, { resolve, reject }));
    return Promise.race([decoding, failed]).finally(() => this.waiting.delete(id));
  }

  private started(): Worker[] {
    // Two at least make a pair; one more would have none.
    const count = navigator.hardwareConcurrency < 4 ? 1 : MOST_HELPERS;
    return Array.from({ length: navigator.hardwareConcurrency < 2 ? 0 : count }, () => {
      const helper = new Worker(self.location.href, { type: "module", name: BAND_WORKER });
      helper.onmessage = ({ data: { id, decoded } }: MessageEvent<Reply>) => {
        if (decoded instanceof Array) this.waiting.get(id)?.resolve(decoded);
        else this.waiting.get(id)?.reject(new Error(decoded.reason));
        this.waiting.delete(id);
      };
      helper.onerror = () => this.withoutHelpers();
      helper.postMessage({ kind: "start", module: this.engine.module } satisfies Request);
      return helper;
    });
  }

  /** Goes on alone. */
  private withoutHelpers(): void {
    this.helpers?.forEach((helper) => helper.terminate());
    this.helpers = [];
    this.waiting.forEach(({ reject }) => reject(new Error("a worker that decodes has ended")));
    this.waiting.clear();
  }
}
