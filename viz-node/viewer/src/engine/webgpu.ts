// Drawing by WebGPU: the kernels of proto/vdi-render and proto/raycast, whose resources the engine gives as bytes.

import present from "./present.wgsl?raw";
import { BAND_ROWS, type Renderer } from "./renderer";
import { type Description, type Engine, FRONT, type Pose, type Resource } from "./wasm";

/** Bytes of a pixel's color: red, green, blue in single precision. */
const COLOR_BYTES = 12;

/** Sizes of pictures whose buffers are kept: of drafts, and of stills. */
const TARGETS = 3;

type Bound = { group: number; binding: number; entry: GPUBindGroupLayoutEntry; resource: GPUBindingResource };

/** Compiled for a representation and a set of effects. */
interface Kernel {
  pipeline: GPUComputePipeline;
  layouts: GPUBindGroupLayout[];
}

/** A step on the device. */
interface Resident extends Kernel {
  bound: Bound[];
  free: () => void;
}

/** Buffers of pictures of one size. */
interface Target {
  side: number;
  colors: GPUBuffer;
  /** The picture in bytes, on the device and for the page. */
  pixels: GPUBuffer;
  copy: GPUBuffer;
}

const layoutEntry = (binding: number, kind: Resource["kind"] | "written"): GPUBindGroupLayoutEntry => {
  const visibility = GPUShaderStage.COMPUTE;
  if (kind === "texture") return { binding, visibility, texture: { sampleType: "uint", viewDimension: "3d" } };
  const type = kind === "uniform" ? "uniform" : kind === "storage" ? "read-only-storage" : "storage";
  return { binding, visibility, buffer: { type } };
};

export class WebGpu implements Renderer {
  readonly api = "WebGPU";
  lost: string | null = null;
  private readonly residents = new Map<number, Resident>();
  private readonly compiling = new Set<string>();
  private readonly kernels = new Map<string, Kernel>();
  private readonly nothing: GPUBuffer;
  /** The last used last. */
  private readonly targets: Target[] = [];

  private constructor(
    private readonly device: GPUDevice,
    private readonly engine: Engine,
    private readonly present: GPUComputePipeline,
    readonly name: string,
  ) {
    this.nothing = device.createBuffer({ size: 16, usage: GPUBufferUsage.STORAGE });
    void device.lost.then((info) => (this.lost ??= info.message || info.reason));
    // What a device refuses once is not drawn: the processor goes on.
    device.onuncapturederror = ({ error }) => (this.lost ??= error.message);
  }

  /** Null where the browser has none that works, or only one in software, which the processor's own renderer outruns. */
  static async open(engine: Engine, software: boolean): Promise<WebGpu | null> {
    const adapter = await navigator.gpu?.requestAdapter({ powerPreference: "high-performance" }).catch(() => null);
    if (!adapter || (adapter.info.isFallbackAdapter && !software)) return null;
    const { maxStorageBufferBindingSize, maxBufferSize, maxTextureDimension3D } = adapter.limits;
    const requiredLimits = { maxStorageBufferBindingSize, maxBufferSize, maxTextureDimension3D };
    const device = await adapter.requestDevice({ requiredLimits }).catch(() => null);
    if (!device) return null;
    const module = device.createShaderModule({ code: present });
    const compute = { module, entryPoint: "present" };
    const pipeline = await device.createComputePipelineAsync({ layout: "auto", compute }).catch(() => null);
    if (!pipeline) return null;
    const { vendor, architecture, description } = adapter.info;
    return new WebGpu(device, engine, pipeline, description || `${vendor} ${architecture}`.trim());
  }

  /** Uploads a step, unless it is there; null while its kernel is compiled, after which `compiled` is called. */
  private load(handle: number, description: Description, compiled: () => void): Resident | null {
    const known = this.residents.get(handle);
    if (known) return known;
    const key = JSON.stringify([description.representation, description.constants]);
    const kernel = this.kernels.get(key);
    if (!kernel) {
      if (!this.compiling.has(key)) void this.compile(key, handle, description).then(compiled);
      return null;
    }
    const owned: { destroy(): void }[] = [];
    const bound = this.engine.bindings(handle).map((resource) => this.upload(resource, owned));
    const resident = { bound, ...kernel, free: () => owned.forEach((one) => one.destroy()) };
    this.residents.set(handle, resident);
    return resident;
  }

  forget(handle: number): void {
    this.residents.get(handle)?.free();
    this.residents.delete(handle);
  }

  ready(handle: number, description: Description, compiled: () => void): boolean {
    return this.load(handle, description, compiled) !== null;
  }

  async draw(handle: number, pose: Pose, side: number, still: boolean, wanted: () => boolean): Promise<ImageBitmap | null> {
    try {
      return await this.picture(handle, pose, side, still, wanted);
    } catch (error) {
      this.lost ??= error instanceof Error ? error.message : String(error);
      throw error;
    }
  }

  private async picture(
    handle: number,
    pose: Pose,
    side: number,
    still: boolean,
    wanted: () => boolean,
  ): Promise<ImageBitmap | null> {
    const resident = this.residents.get(handle)!;
    const target = this.sized(side);
    const rows = still ? BAND_ROWS : side;
    for (let first = 0; first < side; first += rows) {
      this.colors(handle, resident, pose, target, still, [first, Math.min(rows, side - first)]);
      if (!still) continue;
      await this.device.queue.onSubmittedWorkDone();
      if (!wanted()) return null;
    }
    return this.show(target);
  }

  private uniform(bytes: BufferSource & { byteLength: number }, owned: { destroy(): void }[]): GPUBuffer {
    const buffer = this.device.createBuffer({
      size: Math.ceil(bytes.byteLength / 16) * 16,
      usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST,
    });
    this.device.queue.writeBuffer(buffer, 0, bytes);
    owned.push(buffer);
    return buffer;
  }

  private upload({ group, binding, kind, format, dims, bytes }: Resource, owned: { destroy(): void }[]): Bound {
    const entry = layoutEntry(binding, kind);
    if (kind === "uniform") return { group, binding, entry, resource: { buffer: this.uniform(bytes, owned) } };
    if (kind === "texture") {
      const [width, height, depthOrArrayLayers] = dims!;
      const texture = this.device.createTexture({
        size: { width, height, depthOrArrayLayers },
        dimension: "3d",
        format: format!,
        usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST,
      });
      const bytesPerRow = bytes.length / (height * depthOrArrayLayers);
      const size = { width, height, depthOrArrayLayers };
      this.device.queue.writeTexture({ texture }, bytes, { bytesPerRow, rowsPerImage: height }, size);
      owned.push(texture);
      return { group, binding, entry, resource: texture.createView() };
    }
    const buffer = this.device.createBuffer({
      size: Math.max(Math.ceil(bytes.length / 16) * 16, 16),
      usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST,
    });
    this.device.queue.writeBuffer(buffer, 0, bytes);
    owned.push(buffer);
    return { group, binding, entry, resource: { buffer } };
  }

  private async compile(key: string, handle: number, { representation, constants }: Description): Promise<void> {
    this.compiling.add(key);
    // The kinds of resources are those of any view, which the bindings precede.
    const bindings = this.engine.bindings(handle);
    const view = this.engine.view(handle, FRONT, 1, false, [0, 1]);
    const entries: GPUBindGroupLayoutEntry[][] = [];
    for (const { group, binding, kind } of [...bindings, ...view]) {
      (entries[group] ??= []).push(layoutEntry(binding, kind));
    }
    (entries[1] ??= []).push(layoutEntry(1, "storage"), layoutEntry(2, "written"));
    const layouts = entries.map((group) => this.device.createBindGroupLayout({ entries: group }));
    const module = this.device.createShaderModule({ code: this.engine.source(representation) });
    try {
      const pipeline = await this.device.createComputePipelineAsync({
        layout: this.device.createPipelineLayout({ bindGroupLayouts: layouts }),
        compute: { module, entryPoint: "color_rows", constants: Object.fromEntries(constants) },
      });
      this.kernels.set(key, { pipeline, layouts });
    } catch (error) {
      this.lost ??= error instanceof Error ? error.message : String(error);
    }
  }

  private sized(side: number): Target {
    const known = this.targets.find((target) => target.side === side);
    if (known) {
      this.targets.push(...this.targets.splice(this.targets.indexOf(known), 1));
      return known;
    }
    if (this.targets.length === TARGETS) {
      const { colors, pixels, copy } = this.targets.shift()!;
      [colors, pixels, copy].forEach((buffer) => buffer.destroy());
    }
    const { STORAGE, COPY_DST, COPY_SRC, MAP_READ } = GPUBufferUsage;
    const buffer = (bytes: number, usage: GPUBufferUsageFlags) => this.device.createBuffer({ size: bytes * side * side, usage });
    const target: Target = {
      side,
      colors: buffer(COLOR_BYTES, STORAGE),
      pixels: buffer(4, STORAGE | COPY_SRC),
      copy: buffer(4, MAP_READ | COPY_DST),
    };
    this.targets.push(target);
    return target;
  }

  /** Draws some rows, `count` from `first` on. */
  private colors(
    handle: number,
    resident: Resident,
    pose: Pose,
    { side, colors }: Target,
    still: boolean,
    [first, count]: [number, number],
  ): void {
    const owned: { destroy(): void }[] = [];
    const view = this.engine.view(handle, pose, side, still, [first, count]);
    const bound = [...resident.bound, ...view.map((resource) => this.upload(resource, owned))];
    const row = COLOR_BYTES * side;
    const band = { buffer: colors, offset: first * row, size: count * row };
    bound.push({ group: 1, binding: 1, entry: layoutEntry(1, "storage"), resource: { buffer: this.nothing } });
    bound.push({ group: 1, binding: 2, entry: layoutEntry(2, "written"), resource: band });
    const encoder = this.device.createCommandEncoder();
    const pass = encoder.beginComputePass();
    pass.setPipeline(resident.pipeline);
    resident.layouts.forEach((layout, group) => {
      const entries = bound.filter((one) => one.group === group).map(({ binding, resource }) => ({ binding, resource }));
      pass.setBindGroup(group, this.device.createBindGroup({ layout, entries }));
    });
    pass.dispatchWorkgroups(Math.ceil(side / 8), Math.ceil(count / 8));
    pass.end();
    this.device.queue.submit([encoder.finish()]);
    owned.forEach((one) => one.destroy());
  }

  /** The picture, read back: not every browser can hand it to a canvas without the processor. */
  private async show({ side, colors, pixels, copy }: Target): Promise<ImageBitmap> {
    const layout = this.present.getBindGroupLayout(0);
    const entries = [colors, pixels].map((buffer, binding) => ({ binding, resource: { buffer } }));
    const encoder = this.device.createCommandEncoder();
    const pass = encoder.beginComputePass();
    pass.setPipeline(this.present);
    pass.setBindGroup(0, this.device.createBindGroup({ layout, entries }));
    const groups = Math.ceil((side * side) / 64);
    const columns = Math.min(groups, 4096);
    pass.dispatchWorkgroups(columns, Math.ceil(groups / columns));
    pass.end();
    encoder.copyBufferToBuffer(pixels, 0, copy, 0, 4 * side * side);
    this.device.queue.submit([encoder.finish()]);
    await copy.mapAsync(GPUMapMode.READ);
    if (this.lost !== null) throw new Error(this.lost);
    const bytes = new Uint8ClampedArray(copy.getMappedRange().slice(0));
    copy.unmap();
    return createImageBitmap(new ImageData(bytes, side, side));
  }
}
