// A step, or a run's steps one at a time, in a notebook: an anywidget, whose model Python holds (deploy/python/lamina/widget.py).

import { Engine, FRONT, type Pose } from "./engine/wasm";
import { WebGl } from "./engine/webgl";
import { Turntable, unpacked } from "./turntable";

/** What both sides know. */
interface State {
  /** `engine.wasm.gz`. */
  engine: DataView;
  /** The shown step as recorded, decodable without any other. */
  encoded: DataView;
  title: string;
  /** Side of the picture, pixels. */
  size: number;
  /** The run's steps, and the one that is asked for. */
  steps: number[];
  step: number;
  pose: Pose;
}

interface Model {
  get<K extends keyof State>(name: K): State[K];
  set<K extends keyof State>(name: K, value: State[K]): void;
  save_changes(): void;
  on(event: string, heard: () => void): void;
  off(event: string, heard: () => void): void;
}

const bytes = (view: DataView): Uint8Array<ArrayBuffer> => new Uint8Array(view.buffer as ArrayBuffer, view.byteOffset, view.byteLength).slice();

/** Compiled once for all views of a notebook. */
let module: Promise<WebAssembly.Module> | null = null;

function element<K extends keyof HTMLElementTagNameMap>(tag: K, properties: Partial<HTMLElementTagNameMap[K]>): HTMLElementTagNameMap[K] {
  return Object.assign(document.createElement(tag), properties);
}

async function render({ model, el }: { model: Model; el: HTMLElement }): Promise<() => void> {
  const [title, size, steps] = [model.get("title"), model.get("size"), model.get("steps")];
  const canvas = element("canvas", { width: size, height: size, tabIndex: 0 });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `${title}, which can be turned`);
  canvas.style.cssText = `width: min(100%, ${size}px); aspect-ratio: 1; touch-action: none; display: block`;
  const slider = element("input", { type: "range", min: "0", max: String(steps.length - 1), value: String(steps.indexOf(model.get("step"))) });
  slider.setAttribute("aria-label", "Step");
  slider.style.width = `min(100%, ${size}px)`;
  const text = element("div", { role: "status" });
  el.append(canvas, ...(steps.length > 1 ? [slider] : []), text);
  const says = (words: string) => (text.textContent = words);

  module ??= unpacked(bytes(model.get("engine"))).then((wasm) => WebAssembly.compile(wasm));
  const engine = await Engine.of(await module);
  const table = new Turntable(canvas, engine, WebGl.open(engine, false), (pose) => {
    if (JSON.stringify(pose) === JSON.stringify(model.get("pose"))) return;
    model.set("pose", pose);
    model.save_changes();
  });
  const show = () => {
    try {
      table.show(bytes(model.get("encoded")));
      const step = steps.length > 1 ? `, step ${model.get("step")}` : "";
      says(`${title}${step}: drag or arrow keys turn it, the wheel zooms, a double click goes back`);
    } catch (error) {
      says(`It cannot be drawn here: ${error instanceof Error ? error.message : String(error)}`);
    }
  };
  const move = () => table.move({ ...FRONT, ...model.get("pose") });
  const follow = () => (slider.value = String(steps.indexOf(model.get("step"))));
  slider.addEventListener("input", () => {
    model.set("step", steps[Number(slider.value)]!);
    model.save_changes();
  });
  const heard = { "change:encoded": show, "change:pose": move, "change:step": follow };
  Object.entries(heard).forEach(([event, hear]) => model.on(event, hear));
  show();
  move();
  return () => Object.entries(heard).forEach(([event, hear]) => model.off(event, hear));
}

export default { render };
