// The playback of a pose: from rest to the pose and back, smoothly, until it is stopped.

const ROUND_TRIP_MS = 4000;

export class Playback {
  private frame = 0;

  constructor(
    private readonly amount: () => number,
    private readonly onAmount: (amount: number) => void,
    private readonly onChange: (isPlaying: boolean) => void,
  ) {}

  toggle(): void {
    if (this.frame) this.stop();
    else this.start();
  }

  stop(): void {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.onChange(false);
  }

  private start(): void {
    const phase = Math.acos(1 - 2 * this.amount());
    let startedAt: number | null = null;
    const step = (now: number) => {
      startedAt ??= now;
      const angle = phase + (2 * Math.PI * (now - startedAt)) / ROUND_TRIP_MS;
      this.onAmount((1 - Math.cos(angle)) / 2);
      this.frame = requestAnimationFrame(step);
    };
    this.frame = requestAnimationFrame(step);
    this.onChange(true);
  }
}
