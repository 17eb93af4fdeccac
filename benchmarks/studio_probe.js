// Records when the pointer moves, requests are sent, arrays arrive, texts change and frames are drawn.
(() => {
  const probe = { pointers: [], releases: [], requests: [], arrivals: [], texts: [], frames: [] };
  window.studioProbe = probe;
  const kinds = new Map();
  document.addEventListener("pointermove", () => probe.pointers.push(performance.now()), true);
  document.addEventListener("pointerup", () => probe.releases.push(performance.now()), true);

  window.WebSocket = class extends WebSocket {
    constructor(...options) {
      super(...options);
      this.addEventListener("message", ({ data }) => {
        if (typeof data === "string") return;
        const length = new DataView(data).getUint32(0, true);
        const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
        const { kind = "", detail = "" } = kinds.get(header.id) ?? {};
        kinds.delete(header.id);
        const { name, facts } = header;
        probe.arrivals.push({ at: performance.now(), name, kind, detail, phase: facts.phase ?? "" });
      });
    }

    send(data) {
      if (typeof data === "string") {
        const { id, kind, detail } = JSON.parse(data);
        kinds.set(id, { kind, detail });
        probe.requests.push({ at: performance.now(), kind, detail });
      }
      super.send(data);
    }
  };

  // A frame of the scene is an animation frame in which triangles are drawn.
  let triangles = 0;
  let size = 0;
  const getContext = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, ...options) {
    const context = getContext.call(this, kind, ...options);
    if (!/webgl/.test(kind) || !context || context.isProbed) return context;
    context.isProbed = true;
    const draw = context.drawElements.bind(context);
    context.drawElements = (mode, count, ...rest) => {
      if (mode === context.TRIANGLES) triangles += count / 3;
      size = context.drawingBufferWidth * context.drawingBufferHeight;
      draw(mode, count, ...rest);
    };
    return context;
  };
  let countedAt = -1;
  const request = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (action) =>
    request((now) => {
      if (now !== countedAt) {
        countedAt = now;
        if (triangles > 0) probe.frames.push({ at: performance.now(), triangles, size });
        triangles = 0;
      }
      action(now);
    });
  // Also the last frame is noticed.
  const tick = () => window.requestAnimationFrame(tick);
  tick();

  window.watchText = (selector) => {
    probe.texts = [];
    const element = document.querySelector(selector);
    let last = element.textContent;
    new MutationObserver(() => {
      if (element.textContent === last) return;
      last = element.textContent;
      request(() => probe.texts.push(performance.now()));
    }).observe(element, { childList: true, subtree: true, characterData: true });
  };
})();
