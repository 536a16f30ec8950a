// One step that can be turned in a file of its own: engine and step are in the document, in base64.

import { Engine } from "./engine/wasm";
import { WebGl } from "./engine/webgl";
import { Turntable, unpacked } from "./turntable";

const content = (id: string): Uint8Array<ArrayBuffer> =>
  Uint8Array.from(atob(document.getElementById(id)?.textContent ?? ""), (c) => c.charCodeAt(0));

async function start(): Promise<void> {
  const canvas = document.getElementById("turntable") as HTMLCanvasElement;
  try {
    // `?webgl`: also in software.
    const software = new URLSearchParams(location.search).has("webgl");
    const engine = await Engine.of(await WebAssembly.compile(await unpacked(content("lamina-engine"))));
    new Turntable(canvas, engine, WebGl.open(engine, software)).show(content("lamina-step"));
  } catch (error) {
    const sentence = document.createElement("p");
    sentence.textContent = `It cannot be drawn here: ${error instanceof Error ? error.message : String(error)}`;
    canvas.replaceWith(sentence);
  }
}

void start();
