// Drawing by WebGL2: fragment shaders translated from the kernels of WebGPU (engine/examples/glsl.rs), and the same bytes. What
// WebGPU reads as a buffer is here a texture of 16 bytes a texel.

import { BAND_ROWS, type Renderer } from "./renderer";
import vdi from "./vdi.frag?raw";
import volume from "./volume.frag?raw";
import { type Description, type Engine, type Pose, type Resource } from "./wasm";

/** Texels a row of the textures that hold buffers; the shaders know it. */
const BUFFER_COLUMNS = 2048;
const TEXEL_BYTES = 16;

/** Uniform buffers of a group have this many places. */
const GROUP_BINDINGS = 8;

/** One triangle that covers the picture. */
const VERTICES = `#version 300 es
void main() {
    gl_Position = vec4(4.0 * float(gl_VertexID & 1) - 1.0, 4.0 * float(gl_VertexID >> 1) - 1.0, 0.0, 1.0);
}`;

/** Renderers that are a processor, which draws faster by its own. */
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

type Texture = { target: number; texture: WebGLTexture };
type Sampler = { unit: number; group: number; binding: number };

interface Kernel {
  program: WebGLProgram;
  samplers: Sampler[];
}

/** A step on the device. */
interface Resident extends Kernel {
  /** By group and binding. */
  textures: Map<string, Texture>;
  uniforms: Map<number, WebGLBuffer>;
}

const place = ({ group, binding }: { group: number; binding: number }) => `${group} ${binding}`;
const block = ({ group, binding }: { group: number; binding: number }) => group * GROUP_BINDINGS + binding;

/** The shader with its override constants. */
function specialized({ representation, constants }: Description): string {
  let source = representation === "vdi" ? vdi : volume;
  for (const [name, value] of constants) {
    source = source.replace(new RegExp(`^(bool|uint|float) ${name} = .*;$`, "m"), (_, type: string) => {
      const literal = type === "bool" ? String(value !== 0) : type === "uint" ? `${value}u` : String(value);
      return `const ${type} ${name} = ${literal};`;
    });
  }
  return source;
}

export class WebGl implements Renderer {
  readonly api = "WebGL2";
  lost: string | null = null;
  private readonly residents = new Map<number, Resident>();
  private readonly compiling = new Set<string>();
  private readonly kernels = new Map<string, Kernel>();
  private readonly picture: WebGLFramebuffer;
  private readonly colors: WebGLRenderbuffer;

  private constructor(
    private readonly canvas: OffscreenCanvas,
    private readonly gl: WebGL2RenderingContext,
    private readonly engine: Engine,
    readonly name: string,
  ) {
    canvas.addEventListener("webglcontextlost", () => (this.lost ??= "the browser took its WebGL context away"));
    // A picture is drawn in parts: the canvas itself may be emptied between them.
    [this.picture, this.colors] = [gl.createFramebuffer(), gl.createRenderbuffer()];
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.picture);
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.colors);
    gl.bindVertexArray(gl.createVertexArray());
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  }

  /** Null where the browser has none, or only one in software. */
  static open(engine: Engine, software: boolean): WebGl | null {
    const canvas = new OffscreenCanvas(1, 1);
    const gl = canvas.getContext("webgl2", {
      alpha: false,
      antialias: false,
      depth: false,
      failIfMajorPerformanceCaveat: !software,
      powerPreference: "high-performance",
    });
    if (!gl) return null;
    const unmasked = gl.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER;
    const name = String(gl.getParameter(unmasked));
    return SOFTWARE.test(name) && !software ? null : new WebGl(canvas, gl, engine, name);
  }

  ready(handle: number, description: Description, compiled: () => void): boolean {
    if (this.residents.has(handle)) return true;
    const key = JSON.stringify([description.representation, description.constants]);
    const kernel = this.kernels.get(key);
    if (kernel) this.load(handle, kernel);
    else if (!this.compiling.has(key)) void this.compile(key, description).then(compiled);
    return kernel !== undefined;
  }

  forget(handle: number): void {
    const resident = this.residents.get(handle);
    this.residents.delete(handle);
    resident?.textures.forEach(({ texture }) => this.gl.deleteTexture(texture));
    resident?.uniforms.forEach((buffer) => this.gl.deleteBuffer(buffer));
  }

  async draw(handle: number, pose: Pose, side: number, still: boolean, wanted: () => boolean): Promise<ImageBitmap | null> {
    const { gl, canvas } = this;
    this.size(side);
    this.bind(this.residents.get(handle)!, this.engine.view(handle, pose, side, still, [0, side]));
    const rows = still ? BAND_ROWS : side;
    for (let first = 0; first < side; first += rows) {
      const count = Math.min(rows, side - first);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(0, side - first - count, side, count);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      await this.drawn();
      if (!wanted()) return null;
    }
    gl.disable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, side, side, 0, 0, side, side, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.picture);
    return canvas.transferToImageBitmap();
  }

  /** Throws where the device refused something, or is gone. */
  private check(): void {
    const code = this.gl.getError();
    if (code !== this.gl.NO_ERROR) this.lost ??= code === this.gl.OUT_OF_MEMORY ? "out of memory" : `WebGL error ${code}`;
    if (this.lost !== null) throw new Error(this.lost);
  }

  private size(side: number): void {
    const { gl, canvas } = this;
    if (canvas.width === side) return;
    [canvas.width, canvas.height] = [side, side];
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, side, side);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, this.colors);
    gl.viewport(0, 0, side, side);
  }

  /** Waits until what was asked for is drawn. */
  private async drawn(): Promise<void> {
    const { gl } = this;
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.check();
    gl.flush();
    while (fence && gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED && this.lost === null) {
      await new Promise((resolve) => setTimeout(resolve, 1));
    }
    gl.deleteSync(fence);
    this.check();
  }

  private bind({ program, samplers, textures, uniforms }: Resident, view: Resource[]): void {
    const { gl } = this;
    gl.useProgram(program);
    for (const sampler of samplers) {
      const { target, texture } = textures.get(place(sampler))!;
      gl.activeTexture(gl.TEXTURE0 + sampler.unit);
      gl.bindTexture(target, texture);
    }
    for (const resource of view) {
      if (resource.kind === "uniform") uniforms.set(block(resource), this.uniform(resource, uniforms.get(block(resource))));
    }
    uniforms.forEach((buffer, index) => gl.bindBufferBase(gl.UNIFORM_BUFFER, index, buffer));
  }

  private load(handle: number, kernel: Kernel): void {
    const resident: Resident = { ...kernel, textures: new Map(), uniforms: new Map() };
    this.residents.set(handle, resident);
    for (const resource of this.engine.bindings(handle)) {
      if (resource.kind === "uniform") resident.uniforms.set(block(resource), this.uniform(resource));
      else resident.textures.set(place(resource), resource.kind === "texture" ? this.voxels(resource) : this.buffer(resource));
    }
    this.gl.activeTexture(this.gl.TEXTURE0);
  }

  private uniform({ bytes }: Resource, buffer = this.gl.createBuffer()): WebGLBuffer {
    const { gl } = this;
    const padded = new Uint8Array(Math.ceil(bytes.length / TEXEL_BYTES) * TEXEL_BYTES);
    padded.set(bytes);
    gl.bindBuffer(gl.UNIFORM_BUFFER, buffer);
    gl.bufferData(gl.UNIFORM_BUFFER, padded, gl.DYNAMIC_DRAW);
    return buffer;
  }

  private texture(target: number): Texture {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(target, texture);
    // Integers are not interpolated.
    gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return { target, texture };
  }

  private fits(size: number, limit: number): void {
    const most = this.gl.getParameter(limit) as number;
    if (size > most) throw new Error((this.lost ??= `the step needs textures of ${size} texels a side, and WebGL2 has ${most} here`));
  }

  private buffer({ bytes }: Resource): Texture {
    const { gl } = this;
    const texture = this.texture(gl.TEXTURE_2D);
    const rows = Math.max(Math.ceil(bytes.length / TEXEL_BYTES / BUFFER_COLUMNS), 1);
    this.fits(rows, gl.MAX_TEXTURE_SIZE);
    const texels = new Uint32Array((rows * BUFFER_COLUMNS * TEXEL_BYTES) / 4);
    new Uint8Array(texels.buffer).set(bytes);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32UI, BUFFER_COLUMNS, rows, 0, gl.RGBA_INTEGER, gl.UNSIGNED_INT, texels);
    return texture;
  }

  private voxels({ format, dims, bytes }: Resource): Texture {
    const { gl } = this;
    const texture = this.texture(gl.TEXTURE_3D);
    const [width, height, depth] = dims!;
    this.fits(Math.max(width, height, depth), gl.MAX_3D_TEXTURE_SIZE);
    const [inner, type, view] =
      format === "r8uint"
        ? [gl.R8UI, gl.UNSIGNED_BYTE, bytes]
        : format === "r16uint"
          ? [gl.R16UI, gl.UNSIGNED_SHORT, new Uint16Array(bytes.buffer)]
          : [gl.R32UI, gl.UNSIGNED_INT, new Uint32Array(bytes.buffer)];
    gl.texImage3D(gl.TEXTURE_3D, 0, inner, width, height, depth, 0, gl.RED_INTEGER, type, view);
    return texture;
  }

  private async compile(key: string, description: Description): Promise<void> {
    this.compiling.add(key);
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, source] of [
      [gl.VERTEX_SHADER, VERTICES],
      [gl.FRAGMENT_SHADER, specialized(description)],
    ] as const) {
      const shader = gl.createShader(kind)!;
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    // Without the extension the next question waits for the compiler.
    const parallel = gl.getExtension("KHR_parallel_shader_compile");
    while (parallel && this.lost === null && !gl.getProgramParameter(program, parallel.COMPLETION_STATUS_KHR)) {
      await new Promise((resolve) => setTimeout(resolve, 20));
    }
    if (this.lost !== null) return;
    if (gl.getProgramParameter(program, gl.LINK_STATUS)) this.kernels.set(key, { program, samplers: this.placed(program) });
    else {
      const logs = gl.getAttachedShaders(program)!.map((shader) => gl.getShaderInfoLog(shader));
      this.lost = [...logs, gl.getProgramInfoLog(program)].filter(Boolean).join(" ") || "the kernel was not compiled";
    }
  }

  /** Gives the resources of a program, which are named by group and binding, their places. */
  private placed(program: WebGLProgram): Sampler[] {
    const { gl } = this;
    const samplers: Sampler[] = [];
    gl.useProgram(program);
    for (let index = 0; index < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); index++) {
      const { name } = gl.getActiveUniform(program, index)!;
      const [, group, binding] = /_group_(\d+)_binding_(\d+)_fs/.exec(name)!.map(Number) as [number, number, number];
      const [at] = gl.getActiveUniforms(program, [index], gl.UNIFORM_BLOCK_INDEX) as [number];
      if (at >= 0) gl.uniformBlockBinding(program, at, block({ group, binding }));
      else {
        gl.uniform1i(gl.getUniformLocation(program, name), samplers.length);
        samplers.push({ unit: samplers.length, group, binding });
      }
    }
    return samplers;
  }
}
