import type { Scale } from "./scale";

export interface Frame {
  width: number;
  height: number;
  left: number;
  right: number;
  top: number;
  bottom: number;
}

interface AxesProps {
  frame: Frame;
  x: Scale;
  y: Scale;
  /** Name with its unit, such as "Error, mm". */
  xTitle: string;
  yTitle: string;
}

const MIN_TICK_PX = 26;

/** Lines, numbers and titles of two axes. */
export function Axes({ frame, x, y, xTitle, yTitle }: AxesProps) {
  const { width, height, left, right, top, bottom } = frame;
  return (
    <g class="chart-axes" aria-hidden="true">
      {spread(y, 14).map((tick) => (
        <g key={tick}>
          <line x1={left} x2={width - right} y1={y.at(tick)} y2={y.at(tick)} />
          <text x={left - 6} y={y.at(tick) + 4} class="end">
            {tick}
          </text>
        </g>
      ))}
      {spread(x, MIN_TICK_PX).map((tick) => (
        <text key={tick} x={x.at(tick)} y={height - bottom + 15} class="middle">
          {tick}
        </text>
      ))}
      <line class="base" x1={left} x2={width - right} y1={height - bottom} y2={height - bottom} />
      <text x={width / 2} y={height - 3} class="middle title">
        {xTitle}
      </text>
      <text x={2} y={top - 8} class="title">
        {yTitle}
      </text>
    </g>
  );
}

/** The ticks that are at least so many pixels apart. */
function spread({ ticks, at }: Scale, distance: number): number[] {
  let last = -Infinity;
  return ticks.filter((tick) => {
    if (Math.abs(at(tick) - last) < distance) return false;
    last = at(tick);
    return true;
  });
}
