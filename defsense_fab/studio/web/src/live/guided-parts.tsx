// What a guided run shows besides its texts: pictures of cameras, bars and plots.
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { GuidedBars, GuidedCurve, GuidedPicture, GuidedPlot } from "../protocol/messages";
import { connection } from "../state/connection";
import { lineColor } from "./colors";

/** The picture of a camera, which arrives as JPEG. */
export function GuidedPicturePart({ picture }: { picture: GuidedPicture }) {
  const url = useSignal("");
  useEffect(() => {
    const stop = connection.onArrays(picture.array, ({ arrays }) => {
      const content = new Uint8Array(arrays.jpeg!);
      const next = URL.createObjectURL(new Blob([content], { type: "image/jpeg" }));
      URL.revokeObjectURL(url.value);
      url.value = next;
    });
    return () => {
      stop();
      URL.revokeObjectURL(url.value);
    };
  }, [picture.array]);
  return (
    <figure class="guided-picture">
      {url.value ? (
        <img
          class={picture.hasImage ? "" : "outdated"}
          src={url.value}
          alt={`${picture.hasImage ? "Picture" : "Last picture"} of ${picture.name}`}
        />
      ) : (
        <div class="guided-no-picture">No picture</div>
      )}
      <figcaption>
        <strong>{picture.name}</strong> {picture.caption}
      </figcaption>
    </figure>
  );
}

/** Rows of bars; each is filled from the left, over its expected range. */
export function GuidedBarsPart({ bars }: { bars: GuidedBars }) {
  return (
    <figure class="guided-bars">
      {bars.title && <figcaption>{bars.title}</figcaption>}
      <ul>
        {bars.values.map((row, k) => (
          <li key={k}>
            {bars.names[k] !== undefined && <span class="guided-bar-name">{bars.names[k]}</span>}
            <span class="guided-bar-row" aria-hidden="true">
              {row.map((share, column) => (
                <Bar key={column} bars={bars} row={k} share={share} />
              ))}
            </span>
            <span class={`guided-bar-text ${bars.states[k] ?? ""}`}>
              {bars.texts[k] ?? `${Math.round(mean(row) * 100)} %`}
            </span>
          </li>
        ))}
      </ul>
    </figure>
  );
}

function Bar({ bars, row, share }: { bars: GuidedBars; row: number; share: number }) {
  const band = bars.bands[row];
  const number = bars.colors[row];
  const color = number === undefined ? undefined : lineColor(number);
  return (
    <span class={`guided-bar ${bars.states[row] ?? ""}`}>
      {band && (
        <i class="guided-bar-band" style={{ left: percent(band[0]!), width: percent(band[1]! - band[0]!) }} />
      )}
      <i class="guided-bar-fill" style={{ width: percent(share), background: color }} />
    </span>
  );
}

const PLOT_WIDTH = 320;

/** A plot of curves and points. */
export function GuidedPlotPart({ plot }: { plot: GuidedPlot }) {
  const height = Math.round(PLOT_WIDTH * plot.aspect);
  const [left, right] = [plot.x[0]!, plot.x[1]!];
  const [bottom, top] = [plot.y[0]!, plot.y[1]!];
  const toX = (x: number) => ((x - left) / (right - left)) * PLOT_WIDTH;
  const toY = (y: number) => ((top - y) / (top - bottom)) * height;
  return (
    <figure class="guided-plot">
      <figcaption>
        {plot.title}
        {plot.curves
          .filter(({ name }) => name)
          .map((curve) => (
            <span key={curve.name} class="guided-plot-name">
              <i style={{ background: colorOf(curve) }} /> {curve.name}
            </span>
          ))}
      </figcaption>
      <svg viewBox={`0 0 ${PLOT_WIDTH} ${height}`} role="img" aria-label={plot.title || "Plot"}>
        {plot.hasAxes && (
          <path class="guided-plot-axes" d={`M0 ${toY(0)}H${PLOT_WIDTH}M${toX(0)} 0V${height}`} />
        )}
        {plot.curves.map((curve, k) => (
          <g key={k} style={{ color: colorOf(curve) }}>
            {curve.isLine ? (
              <polyline points={curve.x.map((x, n) => `${toX(x)},${toY(curve.y[n]!)}`).join(" ")} />
            ) : (
              curve.x.map((x, n) => <circle key={n} cx={toX(x)} cy={toY(curve.y[n]!)} r="3" />)
            )}
          </g>
        ))}
      </svg>
    </figure>
  );
}

function colorOf({ color }: GuidedCurve): string {
  return color === null ? "var(--muted)" : lineColor(color);
}

function percent(share: number): string {
  return `${Math.round(1000 * share) / 10}%`;
}

function mean(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / Math.max(values.length, 1);
}
