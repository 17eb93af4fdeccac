// Requests of which only the newest matters: one is on its way at a time.

export class LatestRequest<T> {
  private isBusy = false;
  private next: (() => void) | null = null;

  /** Whether an answer is awaited. */
  get isWaiting(): boolean {
    return this.isBusy;
  }

  /**
   * Send a request as soon as the last one is answered; a newer one replaces it before that.
   *
   * The answer is passed with whether no newer request waits.
   */
  ask(
    send: () => Promise<T>,
    onAnswer: (answer: T, isNewest: boolean) => void,
    onError: (error: unknown) => void,
  ): void {
    const start = () => {
      this.isBusy = true;
      send()
        .then((answer) => onAnswer(answer, this.next === null), onError)
        .finally(() => {
          this.isBusy = false;
          const { next } = this;
          this.next = null;
          next?.();
        });
    };
    if (this.isBusy) this.next = start;
    else start();
  }

  /** Forget the request that waits. */
  drop(): void {
    this.next = null;
  }
}
