// The signals of the last seconds, drawn a few times a second.
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { isSoftwareRendered } from "../scene/resolution";
import { onThemeChange } from "../scene/theme";
import { lineColor } from "./colors";
import type { Frame } from "./frame";

const DURATION_S = 15;
const MAX_POINTS = 400;
const DRAW_INTERVAL_MS = 100;
const SLOW_DRAW_INTERVAL_MS = 250; // where the processor draws, which the scene needs
const PERCENT = 100;

/** Keeps the signals of the last seconds. */
export class SignalHistory {
  private readonly rows: { time: number; signals: number[] }[] = [];

  add({ facts, signals }: Frame): void {
    const last = this.rows.at(-1);
    if (last && facts.time <= last.time) this.rows.length = 0; // another run, or a replay
    this.rows.push({ time: facts.time, signals: Array.from(signals) });
    while (facts.time - this.rows[0]!.time > DURATION_S) this.rows.shift();
  }

  /** Times before the newest frame, s, and the signals of each channel in percent. */
  columns(channels: number): uPlot.AlignedData {
    const step = Math.max(Math.floor(this.rows.length / MAX_POINTS), 1);
    const rows = this.rows.filter((_, k) => (this.rows.length - 1 - k) % step === 0);
    const end = rows.at(-1)?.time ?? 0;
    const times = rows.map(({ time }) => time - end);
    const values = Array.from({ length: channels }, (_, c) =>
      rows.map(({ signals }) => (Number.isFinite(signals[c]) ? PERCENT * signals[c]! : null)),
    );
    return [times, ...values];
  }
}

interface SignalPlotProps {
  history: SignalHistory;
  channels: readonly string[];
}

/** A plot of the history, which scrolls automatically. */
export function SignalPlot({ history, channels }: SignalPlotProps) {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const element = host.current!;
    let plot = createPlot(element, channels);
    const draw = () => plot.setData(history.columns(channels.length));
    const rebuild = () => {
      plot.destroy();
      plot = createPlot(element, channels);
      draw();
    };
    const timer = setInterval(draw, isSoftwareRendered() ? SLOW_DRAW_INTERVAL_MS : DRAW_INTERVAL_MS);
    const observer = new ResizeObserver(() => plot.setSize(sizeOf(element)));
    observer.observe(element);
    const stopTheme = onThemeChange(rebuild);
    return () => {
      clearInterval(timer);
      observer.disconnect();
      stopTheme();
      plot.destroy();
    };
  }, [history, channels.join("\n")]);
  return (
    <figure class="signal-plot">
      <figcaption>
        <h3>Signals</h3>
        <ul class="plot-legend" aria-label="Cords of the plot">
          {channels.map((name, k) => (
            <li key={name}>
              <i style={{ background: lineColor(k) }} /> {name}
            </li>
          ))}
        </ul>
      </figcaption>
      <div ref={host} class="plot-host" role="img" aria-label="Signals of the last 15 s, in percent" />
    </figure>
  );
}

function createPlot(host: HTMLElement, channels: readonly string[]): uPlot {
  const style = getComputedStyle(host);
  const font = `11px ${style.fontFamily}`;
  const axis = {
    font,
    stroke: style.getPropertyValue("color"),
    grid: { stroke: "rgb(128 128 128 / 0.22)", width: 1 },
    ticks: { show: false },
  };
  const options: uPlot.Options = {
    ...sizeOf(host),
    legend: { show: false },
    cursor: { show: false },
    padding: [8, 8, 0, 0],
    scales: { x: { time: false, range: [-DURATION_S, 0] }, y: { range: aroundZero } },
    axes: [
      { ...axis, size: 24, values: (_, ticks) => ticks.map((t) => `${t} s`) },
      { ...axis, size: 48, values: (_, ticks) => ticks.map((t) => `${t} %`) },
    ],
    series: [
      {},
      ...channels.map((label, k) => ({
        label,
        stroke: lineColor(k),
        width: 1.75,
        points: { show: false },
      })),
    ],
  };
  return new uPlot(options, [[]], host);
}

/** Limits that contain zero and at least one percent on both sides. */
function aroundZero(_: uPlot, low: number | null, high: number | null): uPlot.Range.MinMax {
  const [from, to] = [Math.min(low ?? 0, -1), Math.max(high ?? 0, 1)];
  const margin = 0.06 * (to - from);
  return [from - margin, to + margin];
}

function sizeOf({ clientWidth, clientHeight }: HTMLElement): { width: number; height: number } {
  return { width: Math.max(clientWidth, 50), height: Math.max(clientHeight, 50) };
}
