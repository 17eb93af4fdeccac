// The legend of a section: its colors from end to end, and what they mean.
import { useEffect, useRef } from "preact/hooks";
import { Checkbox } from "../../ui/choices";
import { type ColorScale, formatValue } from "./color-scale";
import { inside, type SectionView } from "./section-view";

const BAR = { width: 232, height: 12 };

/** The color bar of a section, for the lower left of the scene. */
export function SectionLegend({ view }: { view: SectionView }) {
  const { value: scale } = view.scale;
  const { value: info } = view.info;
  const { value: section } = view.section;
  if (!inside.value?.isReady || !info) return null;
  const isGain = info.name === "next-cord";
  const hovered = view.hover.value?.value;
  return (
    <figure class="section-legend" aria-label={`Colors: ${info.label}`}>
      <figcaption>
        {info.label}
        {info.needsDirection && <> {directionText(view)}</>}, {info.unit}
      </figcaption>
      {view.problem.value ? (
        <p class="legend-problem" role="status">
          {view.problem.value}
        </p>
      ) : (
        scale &&
        section && (
          <>
            <ColorBar scale={scale} hovered={hovered} />
            {isGain ? (
              <p class="legend-note">
                <span class="legend-unknown" style={{ background: unknownColor() }} />
                No cord fits, or not searched
              </p>
            ) : (
              <p class="legend-note">
                In this section {rangeText(section.smallest, section.largest, scale)} {info.unit}
              </p>
            )}
          </>
        )
      )}
      {!isGain && (
        <Checkbox
          label="Fixed over all states"
          hint="Keep the same colors for all states and planes, to compare them"
          isOn={view.isRangeFixed.value}
          onChange={(isOn) => (view.isRangeFixed.value = isOn)}
        />
      )}
    </figure>
  );
}

function ColorBar({ scale, hovered }: { scale: ColorScale; hovered: number | undefined }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => draw(canvas.current!, scale), [scale]);
  const percent = (value: number) => `${100 * scale.shareOf(value)}%`;
  return (
    <div class="color-bar" style={{ width: `${BAR.width}px` }}>
      <canvas ref={canvas} width={BAR.width} height={1} style={{ height: `${BAR.height}px` }} />
      {hovered !== undefined && !Number.isNaN(hovered) && (
        <span class="bar-marker" style={{ left: percent(hovered) }} />
      )}
      {scale.ticks().map((value) => (
        <span key={value} class="bar-tick" style={{ left: percent(value) }}>
          {formatValue(value, scale.range)}
        </span>
      ))}
    </div>
  );
}

/** Paint each pixel with the color that the section has for its value. */
function draw(canvas: HTMLCanvasElement, scale: ColorScale): void {
  const context = canvas.getContext("2d")!;
  const image = context.createImageData(BAR.width, 1);
  const { low, high } = scale.range;
  for (let x = 0; x < BAR.width; x++) {
    const index = scale.indexOf(low + ((x + 0.5) / BAR.width) * (high - low));
    image.data.set(scale.table.subarray(4 * index, 4 * index + 4), 4 * x);
  }
  context.putImageData(image, 0, 0);
}

function unknownColor(): string {
  return `rgb(${(inside.value?.unknownColor ?? []).join()})`;
}

function directionText(view: SectionView): string {
  const cord = view.cord.value;
  return cord ? `(${cord})` : `(${Math.round(view.angle.value)}\u00b0)`;
}

function rangeText(low: number | null, high: number | null, { range }: ColorScale): string {
  if (low === null || high === null) return "no value";
  return `${formatValue(low, range, true)} to ${formatValue(high, range, true)}`;
}
