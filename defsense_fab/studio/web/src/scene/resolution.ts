// The resolution of the picture: lowered while frames are slow, full again when nothing moves.

const SLOW_MS = 40;
const FAST_MS = 24; // live devices send a new shape every 21 ms
const LARGEST_RATIO = 2;
const LOWEST_SHARE = 0.66;
/** Smallest time without a change after which the picture is still, ms, and as a number of frames. */
const STILL_MS = 140;
const STILL_FRAMES = 5;
/** Frames that are farther apart do not follow each other. */
const LARGEST_GAP_MS = 400;

export class Resolution {
  private share = 1;
  private average = 16;
  private last = 0;
  private isMoving = false;
  private isHeavy = false;

  /** Without a graphics card, edges are smoothed by a still picture of twice the resolution. */
  constructor(private readonly isSoftware: boolean) {}

  /** Device pixels per pixel of the page at present. */
  get ratio(): number {
    const full = Math.min(devicePixelRatio, LARGEST_RATIO);
    if (this.isMoving) return full * this.share;
    return this.isSoftware ? LARGEST_RATIO : full;
  }

  /** Whether moving pictures must have fewer triangles. */
  get isCoarse(): boolean {
    return this.isMoving && this.isHeavy;
  }

  /** Whether moving pictures are rendered slowly, at a low resolution. */
  get isSlow(): boolean {
    return this.share < 1;
  }

  /** Time without a change after which the picture is rendered at full resolution, ms. */
  get stillDelay(): number {
    return Math.max(STILL_MS, STILL_FRAMES * this.average);
  }

  /** Record a frame; adapt the resolution of moving pictures. */
  record(now: number): void {
    const gap = now - this.last;
    this.last = now;
    if (gap > LARGEST_GAP_MS || !this.isMoving) return;
    this.average += (gap - this.average) * 0.2;
    if (this.average > SLOW_MS && (this.share > LOWEST_SHARE || !this.isHeavy)) {
      if (this.share < 0.8) this.isHeavy = true;
      this.share = Math.max(LOWEST_SHARE, this.share * 0.7);
      this.average = (SLOW_MS + FAST_MS) / 2;
    } else if (this.average < FAST_MS && this.share < 1) {
      this.share = Math.min(1, this.share * 1.1);
    }
  }

  /** Set whether the picture moves; return whether the resolution changes. */
  setMoving(isMoving: boolean): boolean {
    const before = this.ratio;
    this.isMoving = isMoving;
    return this.ratio !== before;
  }
}

let isSoftware: boolean | null = null;

/** Return whether pictures are rendered by the processor. */
export function isSoftwareRendered(): boolean {
  isSoftware ??= /swiftshader|llvmpipe|software/i.test(rendererName());
  return isSoftware;
}

function rendererName(): string {
  const context = document.createElement("canvas").getContext("webgl2");
  const info = context?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? String(context!.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}
