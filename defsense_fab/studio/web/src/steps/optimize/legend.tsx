import { Key } from "./charts/error-curve";
import { errorMap, MAP_COLORS } from "./error-map";
import { isSearching, layoutLabel, shownLayout } from "./state";

const SCALE_TICKS = 5;

/** What the colors in the scene mean. */
export function OptimizeLegend() {
  const map = errorMap.value;
  const layout = shownLayout.value;
  if (map) return <ColorBar high={map.high} largest={map.largest} />;
  return (
    <div class="optimize-legend">
      <span class="chart-key">
        <i class="chart-mark line device" aria-hidden="true" />
        Drawn cords
      </span>
      {layout && !layout.isDrawn && <Key tone="line layout" text={layoutLabel(layout)} />}
      {!layout && isSearching.value && (
        <>
          <Key tone="line best" text="Best so far" />
          <Key tone="line current" text="Now tried" />
        </>
      )}
    </div>
  );
}

function ColorBar({ high, largest }: { high: number; largest: number }) {
  const stops = MAP_COLORS.map((color) => `rgb(${color.join(" ")})`).join(", ");
  const ticks = Array.from({ length: SCALE_TICKS }, (_, k) => (high * k) / (SCALE_TICKS - 1));
  return (
    <figure class="color-bar">
      <figcaption>Error, mm</figcaption>
      <span class="color-scale" style={{ background: `linear-gradient(90deg, ${stops})` }} />
      <span class="color-ticks">
        {ticks.map((tick) => (
          <span key={tick}>{Number(tick.toPrecision(3))}</span>
        ))}
      </span>
      <span class="muted">
        {largest > high ? `Same scale in all states; up to ${largest.toPrecision(3)} mm` : "Same scale in all states"}
      </span>
    </figure>
  );
}
