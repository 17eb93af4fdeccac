// Requests of which only the newest counts: one is on its way at a time.

export class LatestRequest<Content, Answer> {
  private waiting: Content | null = null;
  private isSending = false;

  constructor(
    private readonly send: (content: Content) => Promise<Answer>,
    private readonly onAnswer: (answer: Answer, content: Content) => void,
    private readonly onError: (error: unknown, content: Content) => void,
  ) {}

  get isIdle(): boolean {
    return !this.isSending;
  }

  /** Send a request, or send it after the one that is on its way, unless a newer one replaces it. */
  give(content: Content): void {
    this.waiting = content;
    if (!this.isSending) void this.run();
  }

  /** Forget the request that waits. */
  clear(): void {
    this.waiting = null;
  }

  private async run(): Promise<void> {
    this.isSending = true;
    while (this.waiting !== null) {
      const content = this.waiting;
      this.waiting = null;
      try {
        const answer = await this.send(content);
        this.onAnswer(answer, content);
      } catch (error) {
        this.onError(error, content);
      }
    }
    this.isSending = false;
  }
}
