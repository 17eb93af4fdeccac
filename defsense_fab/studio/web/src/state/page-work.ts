// Work of this page, such as a search, which the strip shows next to jobs.
import { type Signal, computed, signal } from "@preact/signals";

export interface PageWork {
  title: string;
  /** Completed share, 0 to 1; null while it is unknown. */
  share: Signal<number | null>;
  /** Ends the work; null where it cannot be ended. */
  cancel: (() => void) | null;
  isCanceled: Signal<boolean>;
}

const works = signal<readonly PageWork[]>([]);

/** The work that is shown: the oldest one, as the studio does one after another. */
export const pageWork = computed(() => works.value[0] ?? null);

export function newWork(title: string, cancel: (() => void) | null = null): PageWork {
  return { title, share: signal(null), cancel, isCanceled: signal(false) };
}

/** Show work until its promise has settled. */
export async function showWork<T>(work: PageWork, promise: Promise<T>): Promise<T> {
  works.value = [...works.value, work];
  try {
    return await promise;
  } finally {
    works.value = works.value.filter((other) => other !== work);
  }
}

export function cancelWork(): void {
  const work = pageWork.peek();
  if (!work?.cancel || work.isCanceled.peek()) return;
  work.isCanceled.value = true;
  work.cancel();
}
