// Sends the latest of frequent requests, one at a time.
export class LatestRequest<T> {
  private waiting: { content: T } | null = null;
  private isBusy = false;

  constructor(private readonly send: (content: T) => Promise<unknown>) {}

  give(content: T): void {
    this.waiting = { content };
    if (!this.isBusy) void this.run();
  }

  /** Forget what waits. */
  clear(): void {
    this.waiting = null;
  }

  private async run(): Promise<void> {
    this.isBusy = true;
    while (this.waiting) {
      const { content } = this.waiting;
      this.waiting = null;
      await this.send(content).catch(() => undefined);
    }
    this.isBusy = false;
  }
}
