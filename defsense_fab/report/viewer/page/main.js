// Start the view if the browser can draw it; otherwise a sentence states the reason.
async function start(section) {
  const page = document;
  const note = page.querySelector("[data-v3-note]");
  note.hidden = true;
  const refuse = (why) => {
    section.hidden = true;
    note.textContent = `The 3D view is not shown: ${why}. See the pictures instead.`;
    note.hidden = false;
  };
  const probe = page.createElement("canvas").getContext("webgl2");
  if (!probe) {
    return refuse("this browser has no WebGL, or WebGL is disabled");
  }
  probe.getExtension("WEBGL_lose_context")?.loseContext();
  if (!("DecompressionStream" in window)) {
    return refuse("this browser is too old (it has no DecompressionStream)");
  }
  const content = JSON.parse(page.querySelector("[data-v3-scene]").textContent);
  const arrays = await unpack(page.querySelector("[data-v3-numbers]").textContent, content.arrays);
  section.hidden = false;
  const canvas = section.querySelector("canvas");
  canvas.addEventListener("webglcontextlost", () => refuse("the connection to the graphics card was lost. Reload the page"));
  try {
    const view = { frames: 0 };
    view.stage = new Stage(canvas, { content, arrays }, () => (view.frames += 1));
    view.panel = new Panel(section, view.stage);
    window.defsenseView = view;
    section.dataset.ready = "yes";
  } catch (error) {
    refuse(`it could not start (${error.message})`);
  }
}

start(document.querySelector("[data-v3]"));
