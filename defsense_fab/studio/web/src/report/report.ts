// Start the 3D view of a report if the browser can draw it; otherwise a sentence states the reason.
import type { Content } from "./content";
import { limitWheel, listenForKeys } from "./controls";
import { DeviceView } from "./device-view";
import { type ArrayPlace, unpackArrays } from "./packed-arrays";
import { Panel } from "./panel";
import "./report.css";

/** The section of the view, with the view once it is shown. */
interface ViewSection extends HTMLElement {
  view?: DeviceView;
}

async function start(section: ViewSection): Promise<void> {
  const note = query("[data-view3d-note]");
  note.hidden = true;
  const refuse = (reason: string) => {
    section.hidden = true;
    note.textContent = `The 3D view is not shown: ${reason}. See the pictures instead.`;
    note.hidden = false;
  };
  if (!hasWebGL()) return refuse("this browser has no WebGL, or WebGL is disabled");
  if (!("DecompressionStream" in window)) {
    return refuse("this browser is too old (it has no DecompressionStream)");
  }
  const canvas = section.querySelector("canvas")!;
  canvas.addEventListener("webglcontextlost", () =>
    refuse("the connection to the graphics card was lost. Reload the page"),
  );
  try {
    const content = readJson<Content & { arrays: ArrayPlace[] }>("[data-view3d-scene]");
    const numbers = query("[data-view3d-numbers]").textContent;
    const arrays = await unpackArrays(numbers ?? "", content.arrays);
    section.hidden = false;
    const view = new DeviceView(canvas, { content, arrays });
    listenForKeys(view, new Panel(section, view));
    limitWheel(view, section.querySelector<HTMLElement>("[data-hint]")!);
    section.view = view;
    section.dataset.ready = "";
  } catch (error) {
    refuse(`it could not start (${error instanceof Error ? error.message : String(error)})`);
  }
}

function hasWebGL(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return context !== null;
}

function query(selector: string): HTMLElement {
  return document.querySelector<HTMLElement>(selector)!;
}

function readJson<T>(selector: string): T {
  return JSON.parse(query(selector).textContent ?? "") as T;
}

void start(query("[data-view3d]"));
