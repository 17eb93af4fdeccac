// The error of the search over time: of the layout that it has come to, and of the best one.
import { useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import type { Search } from "../../../protocol/messages";
import { Axes, type Frame } from "./axes";
import { logScale, scaleFromZero } from "./scale";
import { useSize } from "./use-size";

/** Shortest time axis. */
const SHORTEST_S = 1;
const MARGINS = { left: 40, right: 14, top: 26, bottom: 34 };

/** A chart of two lines with a cursor, which follows the pointer and the arrow keys. */
export function ErrorCurve({ search }: { search: Search }) {
  const host = useRef<HTMLDivElement>(null);
  const [width, height] = useSize(host);
  const cursor = useSignal<number | null>(null);
  const { times, currents, bests, drawn } = search;
  const last = times.length - 1;
  const frame: Frame = { width, height, ...MARGINS };
  const x = scaleFromZero([...times, SHORTEST_S], frame.left, width - frame.right);
  const y = logScale(drawn === null ? currents : [...currents, drawn], height - frame.bottom, frame.top);
  const at = cursor.value === null ? null : Math.min(cursor.value, last);
  const shown = at ?? last;
  const text = last < 0 ? "" : describe(times[shown]!, currents[shown]!, bests[shown] ?? null);

  const follow = (event: PointerEvent) => {
    const px = event.clientX - host.current!.getBoundingClientRect().left;
    let best = 0;
    for (let k = 1; k <= last; k++) {
      if (Math.abs(x.at(times[k]!) - px) < Math.abs(x.at(times[best]!) - px)) best = k;
    }
    cursor.value = best;
  };
  const step = (event: KeyboardEvent) => {
    const by = { ArrowRight: 1, ArrowLeft: -1, PageUp: -10, PageDown: 10, Home: -last, End: last }[
      event.key
    ];
    if (by === undefined) return;
    cursor.value = Math.min(last, Math.max(0, (cursor.value ?? last) + by));
    event.preventDefault();
    event.stopPropagation();
  };

  return (
    <figure class="chart-figure">
      <div class="chart" ref={host}>
        {width > 0 && last >= 0 && (
          <svg
            width={width}
            height={height}
            role="slider"
            tabIndex={0}
            aria-label="Expected error over time"
            aria-valuemin={0}
            aria-valuemax={last}
            aria-valuenow={shown}
            aria-valuetext={text}
            onPointerMove={follow}
            onPointerLeave={() => (cursor.value = null)}
            onKeyDown={step}
            onBlur={() => (cursor.value = null)}
          >
            <Axes frame={frame} x={x} y={y} xTitle="Work, s" yTitle="Expected error without the cuts, mm" />
            {drawn !== null && (
              <line class="curve-drawn" x1={frame.left} x2={width - frame.right} y1={y.at(drawn)} y2={y.at(drawn)} />
            )}
            <path class="curve-current" d={path(times, currents, x.at, y.at)} />
            <path class="curve-best" d={path(times, bests, x.at, y.at)} />
            {at !== null && (
              <g class="curve-cursor">
                <line x1={x.at(times[at]!)} x2={x.at(times[at]!)} y1={frame.top} y2={height - frame.bottom} />
                <circle class="current" cx={x.at(times[at]!)} cy={y.at(currents[at]!)} r={4} />
                {bests[at] != null && (
                  <circle class="best" cx={x.at(times[at]!)} cy={y.at(bests[at])} r={4} />
                )}
              </g>
            )}
          </svg>
        )}
      </div>
      <figcaption class="chart-readout">
        <Key tone="best" text="Best so far" />
        <Key tone="current" text="Now tried" />
        {drawn !== null && <Key tone="drawn" text="Drawn" />}
        <output>{text}</output>
      </figcaption>
    </figure>
  );
}

export function Key({ tone, text }: { tone: string; text: string }) {
  return (
    <span class="chart-key">
      <i class={`chart-mark ${tone}`} aria-hidden="true" />
      {text}
    </span>
  );
}

function describe(time: number, current: number, best: number | null): string {
  const start = `${time.toFixed(1)} s: ${current.toFixed(2)} mm`;
  return best === null ? start : `${start}, best ${best.toFixed(2)} mm`;
}

type Pixel = (value: number) => number;

function path(times: readonly number[], errors: readonly (number | null)[], x: Pixel, y: Pixel): string {
  const points = times.flatMap((time, k) => {
    const error = errors[k];
    return error == null ? [] : [`${x(time).toFixed(1)} ${y(error).toFixed(1)}`];
  });
  return points.length === 0 ? "" : `M${points.join("L")}`;
}
