// Starts the view where the browser can draw it; elsewhere one sentence says why it is not there.
async function start(section) {
  const page = document;
  const note = page.querySelector("[data-v3-note]");
  note.hidden = true;
  const refuse = (why) => {
    section.hidden = true;
    note.textContent = `The 3D view is not shown: ${why}. The pictures show the same.`;
    note.hidden = false;
  };
  const probe = page.createElement("canvas").getContext("webgl2");
  if (!probe) {
    return refuse("this browser has no WebGL, or it is switched off");
  }
  probe.getExtension("WEBGL_lose_context")?.loseContext();
  if (!("DecompressionStream" in window)) {
    return refuse("this browser is too old for it (it has no DecompressionStream)");
  }
  const told = JSON.parse(page.querySelector("[data-v3-told]").textContent);
  const arrays = await unpack(page.querySelector("[data-v3-numbers]").textContent, told.arrays);
  section.hidden = false;
  const canvas = section.querySelector("canvas");
  canvas.addEventListener("webglcontextlost", () => refuse("the graphics card was lost; load the page again"));
  try {
    const view = { frames: 0 };
    view.stage = new Stage(canvas, { told, arrays }, () => (view.frames += 1));
    view.panel = new Panel(section, view.stage);
    window.defsenseView = view;
    section.dataset.ready = "yes";
  } catch (error) {
    refuse(`it could not start (${error.message})`);
  }
}

start(document.querySelector("[data-v3]"));
