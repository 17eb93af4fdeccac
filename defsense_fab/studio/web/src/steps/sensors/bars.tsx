// Bars of errors and signals, each with its value as text.

/** Return a signal as text, such as "+4.2 %". */
export function percent(signal: number): string {
  const text = Math.abs(100 * signal).toFixed(1);
  if (Number(text) === 0) return `${text} %`;
  return `${signal < 0 ? "\u2212" : "+"}${text} %`;
}

/** Return a round number that is not smaller: 1, 2 or 5 times a power of ten. */
export function roundUp(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5].map((digit) => digit * power).find((round) => round >= value) ?? 10 * power;
}

interface ErrorBarProps {
  error: number;
  /** Error at the right end, mm. */
  scale: number;
}

export function ErrorBar({ error, scale }: ErrorBarProps) {
  const share = Math.min(1, error / scale);
  return (
    <div class="error-bar">
      <span class="bar-track">
        <span class="error-fill" style={{ width: `${100 * share}%` }} />
      </span>
      <span class="signal-value">{error.toFixed(2)} mm</span>
    </div>
  );
}

interface SignalBarProps {
  signal: number;
  /** Signal at either end. */
  scale: number;
}

/** A bar from the middle: to the right if the resistance rises, to the left if it falls. */
export function SignalBar({ signal, scale }: SignalBarProps) {
  const width = 50 * Math.min(1, Math.abs(signal) / scale);
  const left = signal < 0 ? 50 - width : 50;
  return (
    <div class="signal-bar">
      <span class="signal-track">
        <span
          class={signal < 0 ? "falls" : "rises"}
          style={{ left: `${left}%`, width: `${width}%` }}
        />
      </span>
      <span class="signal-value">{percent(signal)}</span>
    </div>
  );
}
